"""`taskrpc graduate` prints findings as lines or JSON, and one line for unreadable files."""

import json

import pytest

from taskrpc.cli.main import main


def test_json_has_each_finding(tmp_path, capsys):
    (tmp_path / "p.py").write_text("import taskrpc\n")
    assert main(["graduate", str(tmp_path / "p.py"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == [
        {
            "path": str(tmp_path / "p.py"),
            "line": 1,
            "column": 1,
            "what": "taskrpc is imported",
            "ros": "ROS 2 does not have it: ModuleNotFoundError",
            "fix": "write it with rclpy and the interface packages",
        }
    ]


@pytest.mark.parametrize("text", [None, "def (:\n"])
def test_unreadable_file_is_one_line_and_exits_with_2(tmp_path, capsys, text):
    path = tmp_path / "p.py"
    if text is not None:
        path.write_text(text)
    assert main(["graduate", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
