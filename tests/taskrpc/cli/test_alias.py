"""A shell that has taken over `taskrpc alias` knows `ros2`, and passes it every argument whole."""

import os
import shutil
import subprocess
import sys

import pytest

from taskrpc.cli.main import main

pytestmark = pytest.mark.real_time


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_runs_ros2_lines(shell, tmp_path, capsys):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not here")
    command = tmp_path / "taskrpc"
    command.write_text(f"#!{sys.executable}\nimport sys\nprint(sys.argv[1:])\n")
    command.chmod(0o755)
    assert main(["alias", "--shell", shell]) == 0
    definition = capsys.readouterr().out
    line = "ros2 service call /add example_interfaces/srv/AddTwoInts '{a: 2, b: 3}'"
    done = subprocess.run(
        [shell, "-c", f"{definition}{line}"],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=True,
    )
    expected = ["service", "call", "/add", "example_interfaces/srv/AddTwoInts", "{a: 2, b: 3}"]
    assert done.stdout == f"{expected}\n"


def test_powershell_gets_a_function_that_splats_its_arguments(capsys):
    assert main(["alias", "--shell", "powershell"]) == 0
    assert capsys.readouterr().out == "function ros2 { taskrpc @args }\n"


def test_a_shell_must_be_named(capsys):
    assert main(["alias"]) == 2
    assert "--shell" in capsys.readouterr().err
