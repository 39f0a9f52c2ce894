"""A shell that has taken over `taskrpc shell` knows `ros2`, and passes it every argument whole."""

import os
import shutil
import subprocess
import sys

import pytest

from taskrpc.cli.main import main
from taskrpc.cli.shared.completing import candidates

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
def test_bash_knows_what_tutorials_need_and_leaves_a_real_colcon_alone(tmp_path, capsys):
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
            f"#All required rosdeps installed successfully: taskrpc brings what it knows\n{said}"
        )


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not here")
def test_bash_has_taskrpc_itself_in_the_background_and_takes_the_line_twice(tmp_path, capsys):
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
def test_bash_completes_what_is_begun(tmp_path, capsys):
    assert main(["shell", "bash"]) == 0
    definition = capsys.readouterr().out
    (tmp_path / "taskrpc").write_text(f'#!/bin/sh\nexec {sys.executable} -m taskrpc "$@"\n')
    (tmp_path / "taskrpc").chmod(0o755)
    words = "COMP_WORDS=(ros2 service f) COMP_CWORD=2"
    done = subprocess.run(
        ["bash", "-c", f"{definition}{words}; _taskrpc; echo ${{COMPREPLY[@]}}"],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "find\n"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("serv", ["service"]),
        ("service ca", ["call"]),
        ("service list --inc", ["--include-hidden-services"]),
        ("service call /add", ["/add_two_ints"]),
        ("service call /add_two_ints ", ["example_interfaces/srv/AddTwoInts"]),
        ("service call /nobody std_srvs/srv/E", ["std_srvs/srv/Empty"]),
        ("service type -s /sl", ["/sleep"]),
        ("topic echo /t", ["/told"]),
        ("topic pub /heard ", ["std_msgs/msg/String"]),
        ("topic pub /new std_msgs/msg/Str", ["std_msgs/msg/String"]),
        ("topic hz /told /h", ["/heard"]),
        ("node info /", ["/add_two_ints_server", "/other"]),
        ("param get /oth", ["/other"]),
        ("interface show std_srvs/srv/Tr", ["std_srvs/srv/Trigger"]),
        ("pkg prefix example_", ["example_interfaces"]),
        ("run lamp ", ["glow", "shine.py"]),
        ("run la", ["lamp"]),
        ("run lamp shine.py ", []),
        ("daemon status ", []),
        ("nope ", []),
        ("topic echo --qos-depth ", []),
        ("topic echo --qos-depth 5 --csv /to", ["/told"]),
    ],
)
def test_what_may_stand_next(server, tmp_path, monkeypatch, line, expected):
    package = tmp_path / "src" / "lamp"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>lamp</name></package>")
    (package / "setup.py").write_text(
        "setup(entry_points={'console_scripts': ['glow = lamp.glow:main']})"
    )
    (package / "shine.py").touch()
    (package / "CMakeLists.txt").write_text("install(PROGRAMS shine.py DESTINATION lib/lamp)")
    monkeypatch.chdir(tmp_path)
    assert candidates(line.split(" ")) == expected


def test_a_shell_must_be_named(capsys):
    assert main(["shell"]) == 2
    assert "shell" in capsys.readouterr().err
