"""The `ros2 daemon` lines of tutorials succeed."""

import pytest

from taskrpc.cli.main import main


@pytest.mark.parametrize(
    ("verb", "begins"),
    [
        ("start", "No daemon is needed: "),
        ("status", "The daemon is not running: "),
        ("stop", "The daemon is not running: "),
    ],
)
def test_each_daemon_command_prints_a_line_and_succeeds(verb, begins, capsys):
    assert main(["daemon", verb]) == 0
    assert capsys.readouterr().out.startswith(begins)


@pytest.mark.real_time
@pytest.mark.parametrize("command", ["service list", "node list", "topic list", "param list"])
def test_daemon_options_of_ros2_are_accepted(command, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    options = ["--no-daemon", "--spin-time", "2", "-s"]
    assert main([*command.split(), *options]) == 0
