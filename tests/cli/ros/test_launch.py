"""`taskrpc launch` finds launch files, shows what they do, and starts their programs."""

import os
import signal
import subprocess
import sys

import pytest

from taskrpc.cli.main import parser_of
from taskrpc.cli.ros.launch import _launch_file, parse_arguments
from taskrpc.cli.shared.command import UsageError
from taskrpc.errors import TaskRpcError
from taskrpc.ros.missing import explain_program

pytestmark = pytest.mark.real_time

FILE = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo
from launch.substitutions import LaunchConfiguration

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("speed", default_value="2.5", description="metres a second"),
        LogInfo(msg=["speed ", LaunchConfiguration("speed")]),
        ExecuteProcess(cmd=["ros2", "--version"], output="screen"),
    ])
"""


@pytest.fixture
def launch(tmp_path, monkeypatch):
    folder = tmp_path / "src" / "my_robot" / "launch"
    folder.mkdir(parents=True)
    (folder / "robot.launch.py").write_text(FILE)
    (folder.parent / "package.xml").write_text("<package><name>my_robot</name></package>")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))

    def launch(*arguments):
        done = subprocess.run(
            [sys.executable, "-m", "taskrpc", "launch", *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        return done.returncode, done.stdout, done.stderr

    return launch


def test_launch_file_of_a_package_runs_with_arguments(launch):
    code, out, err = launch("my_robot", "robot.launch.py", "speed:=3", "sped:=4")
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert lines[0].startswith("[INFO] [launch]: All log files can be found below ")
    assert lines[1] == "[INFO] [launch]: Default logging verbosity is set to INFO"
    assert lines[2] == "[INFO] [launch.user]: speed 3"
    said = "the launch file does not use the argument 'sped'; did you mean speed?"
    assert f"[WARNING] [launch]: {said}" in lines
    assert any(line.startswith("[ros2-1] taskrpc ") for line in lines)


def test_arguments_and_description_are_shown(launch):
    assert launch("my_robot", "robot.launch.py", "--show-args") == (
        0,
        "Arguments (pass arguments as '<name>:=<value>'):\n\n    'speed':\n"
        "        metres a second\n        (default: '2.5')\n",
        "",
    )
    code, out, _ = launch("src/my_robot/launch/robot.launch.py", "--print")
    assert code == 0
    assert "── LogInfo('speed ' + LaunchConfig('speed'))\n" in out.replace("\\u2500", "─")


def test_missing_package_or_file_is_one_line(launch):
    code, _, err = launch("my_robt", "robot.launch.py")
    assert code == 1
    assert err.startswith("Package 'my_robt' not found: \"package 'my_robt' not found, searching:")
    assert "did you mean my_robot?" in err
    code, _, err = launch("my_robot", "robt.launch.py")
    assert err.startswith("file 'robt.launch.py' was not found in the share directory of package")
    assert "did you mean robot.launch.py?" in err


def test_a_launch_file_of_a_package_with_definitions_only_is_not_here(launch):
    code, _, err = launch("slam_toolbox", "online_async_launch.py")
    assert code == 1
    problem = "taskrpc does not have 'online_async_launch.py' of the package 'slam_toolbox'"
    assert err.startswith(
        f"{problem}\n  hint: its programs are in C++ and run only on a real ROS 2"
    )


def test_missing_path_gets_the_next_step(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problem = "cannot launch robt.launch.py: No such file or directory"
    with pytest.raises(TaskRpcError, match=problem) as caught:
        _launch_file("robt.launch.py", [])
    step = "for a file of a package, write: taskrpc launch PACKAGE robt.launch.py"
    assert caught.value.__notes__ == [step]
    (tmp_path / "robot.launch.py").touch()
    with pytest.raises(TaskRpcError, match=problem) as caught:
        _launch_file("robt.launch.py", ["a:=1"])
    assert caught.value.__notes__ == ["did you mean robot.launch.py?"]
    with pytest.raises(TaskRpcError, match="the folder nope does not exist"):
        _launch_file("nope/a.launch.py", [])


@pytest.mark.parametrize("line", ["-a f.py x:=1", "f.py -a x:=1", "f.py x:=1 -a"])
def test_options_may_stand_anywhere(line):
    options = parser_of("launch").parse_args(["launch", *line.split()])
    assert (options.target, options.rest) == ("f.py", ["x:=1"])
    assert options.show_all_subprocesses_output


@pytest.mark.parametrize(
    ("package", "reason"),
    [
        ("grocery_shop", "taskrpc does not have this package"),
        ("slam_toolbox", explain_program("slam_toolbox")),  # its definitions are here
    ],
)
def test_launch_file_of_a_missing_package_is_left_out(
    launch, tmp_path, monkeypatch, package, reason
):
    (tmp_path / "a.launch.py").write_text(
        "import os\nfrom ament_index_python.packages import get_package_share_directory\n"
        "from launch import LaunchDescription\n"
        "from launch.actions import IncludeLaunchDescription, LogInfo\n"
        "def generate_launch_description():\n"
        "    assert (os.environ['ROS_VERSION'], os.environ['ROS_DISTRO']) == ('2', 'kilted')\n"
        f"    share = get_package_share_directory('{package}')\n"
        "    world = IncludeLaunchDescription(os.path.join(share, 'launch', 'world.launch.py'))\n"
        "    return LaunchDescription([world, LogInfo(msg='the rest')])\n"
    )
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    assert launch("a.launch.py", "--print")[0] == 0
    code, out, _ = launch("a.launch.py")
    assert code == 0
    assert out.splitlines()[2:] == [
        f"[WARNING] [launch]: the launch file world.launch.py of the package '{package}' is left"
        f" out: {reason}",
        "[INFO] [launch.user]: the rest",
    ]


def test_a_launch_file_named_launch_py_does_not_hide_the_package_launch(launch, tmp_path):
    (tmp_path / "launch.py").write_text(FILE)
    code, out, err = launch("launch.py")  # with python -m, which imports from the working directory
    assert (code, err) == (0, "")
    assert out.splitlines()[2] == "[INFO] [launch.user]: speed 2.5"
    code, out, err = launch("launch.py", "--show-args")
    assert (code, err) == (0, "")
    assert "'speed':\n        metres a second" in out


def test_a_folder_named_launch_does_not_hide_the_package_launch(launch, tmp_path):
    (tmp_path / "launch").mkdir()
    (tmp_path / "launch" / "robot.launch.py").write_text(FILE)
    (tmp_path / "program.py").write_text("from launch import LaunchDescription")
    assert launch("launch/robot.launch.py")[0] == 0
    run = [sys.executable, "-m", "taskrpc", "run", "program.py"]
    assert subprocess.run(run, cwd=tmp_path, check=False).returncode == 0


def test_malformed_argument_is_named():
    assert parse_arguments(["a:=1", "a:=2", "b:="]) == {"a": "2", "b": ""}
    for word in ("a", ":=1", "a=1"):
        with pytest.raises(UsageError, match=f"malformed launch argument '{word}'"):
            parse_arguments([word])


@pytest.mark.skipif(sys.platform == "win32", reason="no process gets just a Ctrl-C there")
def test_ctrl_c_ends_all_programs(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    (tmp_path / "a.launch.xml").write_text(
        f"<launch><executable cmd=\"{sys.executable} -c 'import time; print(1); time.sleep(600)'\""
        ' output="screen" name="p"><env name="PYTHONUNBUFFERED" value="1"/></executable></launch>'
    )
    command = [sys.executable, "-m", "taskrpc", "launch", str(tmp_path / "a.launch.xml")]
    with subprocess.Popen(command, stdout=-1, text=True) as process:
        while process.stdout.readline() != "[p-1] 1\n":
            pass
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "[WARNING] [launch]: user interrupted with ctrl-c (SIGINT)\n" in out
    assert "[ERROR] [p-1]: process has died [pid " in out


@pytest.mark.skipif(sys.platform != "win32", reason="only Windows has Ctrl-Break")
def test_ctrl_break_ends_nodes_as_ctrl_c_does(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    path = tmp_path / "a.launch.xml"
    path.write_text('<launch><node pkg="demo_nodes_py" exec="talker" output="screen"/></launch>')
    group = subprocess.CREATE_NEW_PROCESS_GROUP
    command = [sys.executable, "-m", "taskrpc", "launch", str(path)]
    with subprocess.Popen(command, stdout=-1, text=True, creationflags=group) as process:
        while "Publishing" not in process.stdout.readline():
            pass
        os.kill(process.pid, signal.CTRL_BREAK_EVENT)
        out, _ = process.communicate(timeout=60)
    assert "[INFO] [talker-1]: process has finished cleanly [pid " in out
