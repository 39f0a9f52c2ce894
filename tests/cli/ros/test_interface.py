"""`taskrpc interface` prints what `ros2 interface` prints."""

from __future__ import annotations

import io
import json

import pytest

from taskrpc.cli.main import main

OUTER = """\
# What to paint.
Dot[] dots  # some

---
bool done
"""
DOT = """\
# A place.

int32 x   # to the right
int32 y 7
"""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Runs `taskrpc interface …` beside a package of one's own."""
    for kind, name, text in (("srv", "Paint", OUTER), ("msg", "Dot", DOT)):
        folder = tmp_path / "paint_msgs" / kind
        folder.mkdir(parents=True)
        (folder / f"{name}.{kind}").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    def _run(*argv):
        code = main(["interface", *argv])
        out, err = capsys.readouterr()
        return code, out, err

    return _run


def test_show_has_own_comments_and_nested_fields_indented_by_a_tab(run):
    assert run("show", "paint_msgs/srv/Paint") == (
        0,
        "# What to paint.\nDot[] dots  # some\n\tint32 x\n\tint32 y 7\n\n---\nbool done\n",
        "",
    )


def test_show_without_comments_and_with_all(run):
    out = run("show", "paint_msgs/srv/Paint", "--no-comments")[1]
    assert out == "Dot[] dots\n\tint32 x\n\tint32 y 7\n---\nbool done\n"
    out = run("show", "paint_msgs/srv/Paint", "--all-comments")[1]
    assert "\t# A place.\n" in out
    assert "\tint32 x   # to the right\n" in out


def test_proto_prints_the_default_request_in_double_quotes(run):
    assert run("proto", "example_interfaces/srv/AddTwoInts") == (0, '"a: 0\nb: 0\n"\n', "")
    assert run("proto", "paint_msgs/msg/Dot", "--no-quotes") == (0, "x: 0\ny: 7\n\n", "")
    assert run("proto", "paint_msgs/srv/Paint") == (0, '"dots: []\n"\n', "")
    assert run("proto", "std_srvs/srv/Empty") == (0, '"{}\n"\n', "")
    assert json.loads(run("proto", "paint_msgs/msg/Dot", "--json")[1]) == {"x": 0, "y": 7}


def test_proto_of_an_action_is_its_goal(run):
    assert run("proto", "example_interfaces/action/Fibonacci") == (0, '"order: 0\n"\n', "")


def test_package_lists_its_interfaces(run):
    assert run("package", "paint_msgs") == (0, "paint_msgs/msg/Dot\npaint_msgs/srv/Paint\n", "")


def test_package_lists_the_selected_kinds_only(run):
    assert run("package", "-m", "paint_msgs") == (0, "paint_msgs/msg/Dot\n", "")
    assert run("package", "paint_msgs", "-s") == (0, "paint_msgs/srv/Paint\n", "")
    assert run("package", "paint_msgs", "--only-actions") == (0, "", "")
    both = run("package", "paint_msgs", "-s", "--only-msgs", "-a")
    assert both == run("package", "paint_msgs")


def test_list_has_the_order_of_ros2_with_any_order_of_options(run):
    lines = run("list", "-s", "-m")[1].splitlines()
    headings = [line for line in lines if not line.startswith("    ")]
    assert headings == ["Messages:", "Services:"]


def test_unknown_package_exits_with_1_and_suggests_similar_names(run):
    assert run("package", "paint_msg") == (
        1,
        "",
        "Unknown package 'paint_msg'\n  hint: did you mean paint_msgs?\n",
    )


def test_packages_may_be_limited_to_kinds(run):
    everything = run("packages")[1].splitlines()
    assert {"paint_msgs", "std_msgs", "std_srvs"} <= set(everything)
    services = run("packages", "-s")[1].splitlines()
    assert "std_msgs" not in services
    assert "paint_msgs" in services
    assert "example_interfaces" in run("packages", "-a")[1].splitlines()


def test_list_has_a_heading_for_each_kind_and_indents_by_four(run):
    lines = run("list")[1].splitlines()
    headings = [line for line in lines if not line.startswith("    ")]
    assert headings == ["Messages:", "Services:", "Actions:"]
    assert "    paint_msgs/srv/Paint" in lines[lines.index("Services:") :]
    assert run("list", "-a")[1].startswith("Actions:\n    ")
    assert set(run("list", "-m", "-s")[1].splitlines()) >= {"Messages:", "Services:"}
    assert "paint_msgs/msg/Dot" in json.loads(run("list", "-m", "--json")[1])


@pytest.mark.parametrize("verb", ["show", "proto"])
@pytest.mark.parametrize("name", ["Paint", "paint_msgs/srv/Pait", "paint/srv/Paint", "x"])
def test_an_unknown_type_is_one_message(run, verb, name):
    code, out, err = run(verb, name)
    assert (code, out) == (1, "")
    assert err
    assert "Traceback" not in err


def test_show_reads_a_type_that_is_piped_in(capsys, monkeypatch):
    monkeypatch.setattr(
        "sys.stdin", io.TextIOWrapper(io.BytesIO(b"example_interfaces/srv/AddTwoInts\n"))
    )
    assert main(["interface", "show", "-", "--no-comments"]) == 0
    assert capsys.readouterr().out == "int64 a\nint64 b\n---\nint64 sum\n"


@pytest.mark.parametrize("folder", [".", "src", "src/things", "src/nodes"])
def test_definitions_are_found_from_everywhere_in_a_workspace(
    capsys, tmp_path, monkeypatch, folder
):
    for name in ("things/own_things", "nodes"):
        package = tmp_path / "src" / name
        package.mkdir(parents=True)
        (package / "package.xml").write_text(f"<package><name>{package.name}</name></package>")
    definition = tmp_path / "src" / "things" / "own_things" / "msg" / "Dot.msg"
    definition.parent.mkdir()
    definition.write_text("int32 x\n")
    monkeypatch.chdir(tmp_path / folder)
    assert main(["interface", "show", "own_things/msg/Dot"]) == 0
    assert main(["interface", "proto", "own_things/msg/Dot", "--no-quotes"]) == 0
    assert capsys.readouterr().out == "int32 x\nx: 0\n\n"


def test_the_services_of_tutorials_are_shown_as_ros2_shows_them(capsys):
    for name, text in (
        ("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n---\nint64 sum\n"),
        ("std_srvs/srv/Empty", "---\n"),
    ):
        assert main(["interface", "show", name]) == 0
        assert capsys.readouterr().out == text
