"""The graph that view_frames writes."""

import importlib
from types import SimpleNamespace

import pytest
import yaml


@pytest.fixture
def generate_dot(ros_names):
    return importlib.import_module("tf2_tools.view_frames").generate_dot


def test_graph_has_the_format_of_ros(generate_dot):
    data = yaml.safe_load(
        "odom: \n  parent: 'base_link'\n  broadcaster: 'default_authority'\n  rate: 10000.000\n"
        "  most_recent_transform: 0.000000\n  oldest_transform: 0.000000\n  buffer_length: 0.000\n"
    )
    assert generate_dot(data, (12, 500_000_000)) == (
        "digraph G {\n"
        '"base_link" -> "odom"[label=" Broadcaster: default_authority\\nAverage rate: 10000.0\\n'
        'Buffer length: 0.0\\nMost recent transform: 0.0\\nOldest transform: 0.0\\n"];\n'
        "edge [style=invis];\n"
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";\n'
        '"Recorded at time: 12.5"[ shape=plaintext ] ;\n'
        '}->"base_link";\n}'
    )


@pytest.mark.parametrize(
    ("dot", "said"),
    [
        (
            FileNotFoundError(),
            "tree.pdf was not written, because graphviz (the command dot) is not",
        ),
        (None, "Exporting graph in tree.pdf file..."),
    ],
)
def test_graph_is_written_with_and_without_graphviz(ros_names, tmp_path, monkeypatch, dot, said):
    module = importlib.import_module("tf2_tools.view_frames")
    called, lines = [], []

    def run(command, check):
        called.append(command)
        if dot is not None:
            raise dot

    logger = SimpleNamespace(info=lines.append, warning=lines.append)
    clock = SimpleNamespace(now=lambda: SimpleNamespace(seconds_nanoseconds=lambda: (1, 0)))
    node = SimpleNamespace(get_logger=lambda: logger, get_clock=lambda: clock)
    monkeypatch.setattr(module.subprocess, "run", run)
    monkeypatch.setattr(
        module, "Buffer", lambda node: SimpleNamespace(all_frames_as_yaml=lambda: "[]")
    )
    monkeypatch.setattr(
        module, "TransformListener", lambda *_, **__: SimpleNamespace(unregister=lambda: None)
    )
    monkeypatch.chdir(tmp_path)
    module._view(node, module._parser().parse_args(["-t", "0", "-o", "tree"]))
    assert called == [["dot", "-Tpdf", "tree.gv", "-o", "tree.pdf"]]
    assert "No tf data received" in (tmp_path / "tree.gv").read_text()
    assert lines[0] == "Listening to tf data for 0.0 seconds..."
    assert lines[-1].startswith(said)


def test_graph_without_frames_or_root(generate_dot):
    assert generate_dot([], (0, 0)) == 'digraph G { "No tf data received" }'
    frame = {"broadcaster": "me", "rate": 1, "buffer_length": 0}
    times = {"most_recent_transform": 0, "oldest_transform": 0}
    loop = {name: {"parent": parent, **frame, **times} for name, parent in ("ab", "ba")}
    assert generate_dot(loop, (0, 0)).endswith("[ shape=plaintext ] ;\n}\n}")
