"""A shell with the definitions of `taskrpc shell` runs and completes `ros2` lines."""

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
    assert main(["shell", shell]) == 0
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
    assert main(["shell", "powershell"]) == 0
    assert capsys.readouterr().out.startswith("function ros2 { taskrpc @args }\n")


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not here")
def test_bash_defines_the_commands_of_tutorials_but_no_existing_colcon(tmp_path, capsys):
    assert main(["shell", "bash"]) == 0
    definition = capsys.readouterr().out
    for name in ("taskrpc", "colcon"):
        (tmp_path / name).write_text(f"#!/bin/sh\necho {name} $@\n")
        (tmp_path / name).chmod(0o755)
    lines = f"{definition}rosdep install -i\ncolcon build\n"
    for is_real, said in ((True, "colcon build\n"), (False, "taskrpc colcon build\n")):
        if not is_real:
            (tmp_path / "colcon").unlink()
        done = subprocess.run(
            ["bash", "-c", lines],
            env={"PATH": f"{tmp_path}:/usr/bin:/bin"},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == (
            f"#All required rosdeps installed successfully (taskrpc installs nothing)\n{said}"
        )


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not here")
def test_bash_runs_taskrpc_itself_in_the_background_and_accepts_the_line_twice(tmp_path, capsys):
    assert main(["shell", "bash"]) == 0
    (tmp_path / "definition").write_text(capsys.readouterr().out)
    (tmp_path / "taskrpc").write_text('#!/bin/sh\n[ "$1" = shell ] || echo $$\ncat definition\n')
    (tmp_path / "taskrpc").chmod(0o755)
    take = 'eval "$(taskrpc shell bash)"'
    lines = f"{take}\n{take}; ros2 one >/dev/null\nros2 run >pid &\necho $!\nwait $!\nhead -1 pid\n"
    done = subprocess.run(
        ["bash", "-c", lines],
        cwd=tmp_path,
        env={"PATH": f"{tmp_path}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=True,
    )
    given, own = done.stdout.split()
    assert given == own
    assert done.stderr == ""


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not here")
def test_bash_completes_each_command(tmp_path, capsys):
    assert main(["shell", "bash"]) == 0
    definition = capsys.readouterr().out
    modules = {
        "taskrpc": "taskrpc",
        "taskrpc-call": "taskrpc.cli.call",
        "taskrpc-server": "taskrpc.cli.robot.server.command_line",
        "srvgen": "srvgen",
    }
    for name, module in modules.items():
        (tmp_path / name).write_text(f'#!/bin/sh\nexec {sys.executable} -m {module} "$@"\n')
        (tmp_path / name).chmod(0o755)
    expected = {
        "ros2 service f": "find",
        "taskrpc ali": "",
        "taskrpc-call --time": "--timeout",
        "taskrpc-server --log-level w": "warning",
        "srvgen show std_srvs/srv/Tr": "std_srvs/srv/Trigger",
    }
    lines = "".join(
        f'COMP_LINE="{line}" COMP_POINT={len(line)} COMP_TYPE=9\nCOMPREPLY=()\n'
        f"_python_argcomplete {line.split()[0]}\necho ${{COMPREPLY[0]}}\n"
        for line in expected
    )
    done = subprocess.run(
        ["bash", "-c", f"{definition}{lines}"],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == list(expected.values())


def test_a_shell_without_the_extra_says_how_to_get_completion(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "argcomplete.shell_integration", None)
    assert main(["shell", "bash"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "# completion with TAB needs argcomplete: pip install argcomplete"


def test_shell_name_is_required(capsys):
    assert main(["shell"]) == 2
    assert "shell" in capsys.readouterr().err
