"""`taskrpc run` runs an unmodified ROS program, and ends as Python does."""

import shlex
import shutil
import signal
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]


@pytest.fixture
def run(tmp_path):
    def run(source, *arguments, module=False, prefix=()):
        (tmp_path / "program.py").write_text(source)
        program = ["-m", "program"] if module else ["program.py"]
        done = subprocess.run(
            [sys.executable, "-m", "taskrpc", "run", *prefix, *program, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.mark.parametrize("module", [False, True])
def test_a_program_imports_rclpy_and_interfaces_in_any_order_and_has_its_arguments(run, module):
    source = (
        "from std_srvs.srv import SetBool\n"
        "import rclpy, sys\n"
        "from rclpy.task import Future\n"
        "print(__name__, sys.argv[1:], Future, type(SetBool.Request()))\n"
    )
    assert run(source, "-x", "--ros-args", "-r", "a:=b", module=module) == (
        0,
        "__main__ ['-x', '--ros-args', '-r', 'a:=b'] <class 'rclpy.task.Future'>"
        " <class 'std_srvs.srv._set_bool.SetBool_Request'>\n",
        "",
    )


STARTER = "import subprocess, sys; sys.exit(subprocess.call(sys.argv[1:]))"
PREFIX = f"{shlex.quote(sys.executable)} -c '{STARTER}'"


@pytest.mark.parametrize("prefix", [(), ("--prefix", PREFIX)], ids=["", "prefix"])
def test_code_runs_and_fails_as_python_c_does(tmp_path, prefix):
    folder = tmp_path / "my_things" / "srv"
    folder.mkdir(parents=True)
    (folder / "Ask.srv").write_text("int64 a\n---\nint64 b\n")
    code = (
        "import rclpy, sys\nfrom my_things.srv import Ask\n"
        "print(__name__, sys.argv, Ask.Request(a=2))\n1 / 0"
    )
    done = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", *prefix, "-c", code, "-x", "--ros-args"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    expected = "__main__ ['-c', '-x', '--ros-args'] my_things.srv.Ask_Request(a=2)\n"
    assert (done.returncode, done.stdout) == (1, expected)
    first, where, *_, last = done.stderr.splitlines()
    assert first == "Traceback (most recent call last):"
    assert where == '  File "<string>", line 4, in <module>'
    assert last == "ZeroDivisionError: division by zero"


def test_a_package_beside_the_script_is_found_wherever_it_is_started(run, tmp_path):
    folder = tmp_path / "my_things" / "srv"
    folder.mkdir(parents=True)
    (folder / "Ask.srv").write_text("int64 a\n---\nint64 b\n")
    assert run("from my_things.srv import Ask\nprint(Ask.Request(a=2))\n") == (
        0,
        "my_things.srv.Ask_Request(a=2)\n",
        "",
    )


SPAWNS = """
import multiprocessing
import rclpy
from my_things.srv import Ask

def work(result):
    rclpy.init()
    result.put((rclpy.create_node("child").get_name(), Ask.Request(a=2).a))
    rclpy.shutdown()

if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    result = context.Queue()
    child = context.Process(target=work, args=(result,))
    child.start()
    print(result.get(timeout=120))
    child.join()
"""


def test_processes_that_a_program_spawns_import_what_it_does(run, tmp_path):
    folder = tmp_path / "my_things" / "srv"
    folder.mkdir(parents=True)
    (folder / "Ask.srv").write_text("int64 a\n---\nint64 b\n")
    assert run(SPAWNS) == (0, "('child', 2)\n", "")


def test_a_program_ends_with_its_own_status(run):
    assert run("import sys\nsys.exit(7)\n")[0] == 7


def test_program_is_compiled_and_found_as_by_python_itself(run):
    source = (
        "# -*- coding: latin-1 -*-\n"
        "import sys, os\n"
        "def f(x: int): pass\n"
        "print(f.__annotations__, sys.path[0] == os.getcwd(), __file__, __doc__, __spec__)\n"
    )
    assert run(source) == (0, "{'x': <class 'int'>} True program.py None None\n", "")


def test_messages_of_a_program_are_as_in_ros(run, monkeypatch):
    """With numpy's arrays and types of fields; here all fields are checked, too."""
    pytest.importorskip("numpy")
    monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
    source = (
        "from geometry_msgs.msg import PoseWithCovariance\n"
        "from rosidl_parser.definition import Array\n"
        "import rclpy.serialization as cdr\n"
        "message = PoseWithCovariance()\n"
        "message.covariance.reshape(6, 6)[1, 1] = 0.5\n"
        "again = cdr.deserialize_message(cdr.serialize_message(message), PoseWithCovariance)\n"
        "print(again.covariance[7], again == message)\n"
        "print(isinstance(PoseWithCovariance.SLOT_TYPES[1], Array))\n"
        "try: message.pose = 5\n"
        "except AssertionError as error: print(error)\n"
    )
    told = "The 'pose' field must be a sub message of type 'Pose'"
    assert run(source) == (0, f"0.5 True\nTrue\n{told}\n", "")


def test_traceback_shows_only_frames_of_the_program(run):
    code, _, error = run("def f():\n    1/0\n\nf()\n")
    assert code == 1
    assert error.splitlines()[:2] == [
        "Traceback (most recent call last):",
        '  File "program.py", line 4, in <module>',
    ]
    assert "taskrpc" not in error


_NODE = "import rclpy, threading\nrclpy.init()\nnode = rclpy.create_node('n')\n"
_TICK = _NODE + "def tick():\n    1/0\nnode.create_timer(0.01, tick)\n"
_POOL = "executor = rclpy.executors.MultiThreadedExecutor()\nexecutor.add_node(node)\n"


@pytest.mark.parametrize(
    ("source", "last"),
    [
        (_TICK + "rclpy.spin(node)\n", "ZeroDivisionError"),
        (_TICK + _POOL + "executor.spin()\n", "ZeroDivisionError"),
        (
            _TICK + "thread = threading.Thread(target=rclpy.spin, args=[node])\n"
            "thread.start()\nthread.join()\n",
            "ZeroDivisionError",
        ),
        (_NODE + "rclpy.create_node('a b')\n", "rclpy.exceptions.InvalidNodeNameException"),
        (_NODE + "node.create_publisher(int, 't', 1)\n", "AttributeError"),
        ("import rclpy\nrclpy.create_node('n')\n", "rclpy.exceptions.NotInitializedException"),
        (
            "import rclpy.node\nrclpy.init()\n"
            "class N(rclpy.node.Node):\n    def __init__(self): self.create_timer(1, print)\nN()\n",
            "AttributeError",
        ),
        (
            _NODE + "from rclpy.action import ActionClient, ActionServer\n"
            "from example_interfaces.action import Fibonacci\n"
            "server = ActionServer(node, Fibonacci, 'count', lambda goal: 1/0)\n"
            "client = ActionClient(node, Fibonacci, 'count')\n"
            "client.wait_for_server()\n"
            "sent = client.send_goal_async(Fibonacci.Goal())\n"
            "rclpy.spin_until_future_complete(node, sent)\n"
            "result = sent.result().get_result_async()\n"
            "rclpy.spin_until_future_complete(node, result)\n",
            "ZeroDivisionError",
        ),
    ],
)
def test_a_traceback_has_no_lines_of_the_library(run, source, last):
    _, _, error = run(source)
    assert f"\n{last}: " in error
    places = [line.strip() for line in error.splitlines() if line.startswith("  File ")]
    assert places
    assert all(line.startswith('File "program.py"') for line in places)


@pytest.mark.skipif(sys.platform == "win32", reason="no process gets just a Ctrl-C there")
def test_ctrl_c_is_one_line_and_ends_as_python_does_unless_the_program_catches_it(tmp_path):
    start = "import rclpy, time\nrclpy.init()\nnode = rclpy.create_node('n')\n"
    up = "print(1, flush=True)"
    for source, code, error in (
        (f"{up}; rclpy.spin(node)", -signal.SIGINT, "KeyboardInterrupt\n"),
        (f"{up}; time.sleep(60)", -signal.SIGINT, "KeyboardInterrupt\n"),
        (f"try: {up}; rclpy.spin(node)\nexcept KeyboardInterrupt: rclpy.shutdown()", 0, ""),
    ):
        (tmp_path / "program.py").write_text(start + source)
        command = [sys.executable, "-m", "taskrpc", "run", str(tmp_path / "program.py")]
        with subprocess.Popen(command, stdout=-1, stderr=-1, text=True) as process:
            assert process.stdout.readline() == "1\n"
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=120) == ("", error)
        assert process.returncode == code


@pytest.mark.skipif(sys.platform == "win32", reason="no process is killed by a signal there")
def test_exit_functions_run_and_output_is_written_before_a_program_dies_of_ctrl_c(run):
    source = (
        "import atexit, os, signal\natexit.register(lambda: print('end'))\n"
        "print('begun')\nos.kill(os.getpid(), signal.SIGINT)\nprint('never')\n"
    )
    assert run(source) == (-signal.SIGINT, "begun\nend\n", "KeyboardInterrupt\n")
    # A command in front of it, such as nice, leaves the status as it is.
    assert run(source, prefix=["--prefix", "env"])[0] == -signal.SIGINT


@pytest.mark.skipif(sys.platform == "win32", reason="no process gets just a Ctrl-C there")
def test_second_ctrl_c_ends_the_program_silently(tmp_path):
    source = (
        "import rclpy, atexit, time\n"
        "def end():\n    print(2, flush=True)\n    time.sleep(60)\n"
        "atexit.register(end)\n"
        "rclpy.init()\nnode = rclpy.create_node('n')\nprint(1, flush=True)\nrclpy.spin(node)\n"
    )
    (tmp_path / "program.py").write_text(source)
    command = [sys.executable, "-m", "taskrpc", "run", str(tmp_path / "program.py")]
    with subprocess.Popen(command, stdout=-1, stderr=-1, text=True) as process:
        for line in ("1\n", "2\n"):
            assert process.stdout.readline() == line
            process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=120) == ("", "KeyboardInterrupt\n")
    assert process.returncode == -signal.SIGINT


def test_missing_program_is_one_line(run):
    command = [sys.executable, "-m", "taskrpc", "run"]
    for arguments, line in (
        (["nope.py"], "cannot run nope.py: No such file or directory\n"),
        (["-m", "nope_nope"], "No module named nope_nope\n"),
    ):
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (1, "", line)


@pytest.fixture
def workspace(tmp_path):
    """A workspace with an interface package and a Python package; runs `taskrpc run` in it."""

    def write(path, text):
        path = tmp_path / "ws" / "src" / path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    for name in ("my_things", "nodes", "helpers"):
        write(f"{name}/package.xml", f"<package><name>{name}</name></package>")
    write("my_things/srv/Ask.srv", "int64 a\n---\nint64 b\n")
    write("nodes/setup.py", "setup(entry_points={'console_scripts': ['ask = nodes.ask:main']})")
    write("nodes/nodes/__init__.py", "")
    write("helpers/helpers/__init__.py", "def help(): return 'helped'\n")
    write("nodes/config/values.yaml", "1")
    source = (
        "import sys, os\n"
        "from my_things.srv import Ask\n"
        "from helpers import help\n"
        "from ament_index_python.packages import get_package_share_directory as share\n"
        "from rosidl_runtime_py.utilities import get_service\n"
        "def main():\n"
        "    print(help(), os.listdir(share('nodes') + '/config'), sys.argv[1:])\n"
        "    print(get_service('my_things/srv/Ask') is Ask)\n"
        "    return 3\n"
    )
    write("nodes/nodes/ask.py", source + "if __name__ == '__main__': main()\n")

    def run(*arguments, folder="."):
        done = subprocess.run(
            [sys.executable, "-m", "taskrpc", "run", *arguments],
            cwd=tmp_path / "ws" / folder,
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        return done.returncode, done.stdout, done.stderr

    return run


_FAILED = "[ros2run]: Process exited with failure 3\n"
_SAID = "helped ['values.yaml'] ['-x']\nTrue\n"


INTERRUPTED = 130 if sys.platform == "win32" else -signal.SIGINT
"""The status of a program that did not catch its KeyboardInterrupt, as Python's own."""


def test_executable_of_a_workspace_runs_from_its_source(workspace):
    for folder in (".", "src/my_things"):
        assert workspace("nodes", "ask", "-x", folder=folder) == (3, _SAID + _FAILED, "")


def test_failed_executable_prints_the_line_of_ros2_run(workspace, tmp_path):
    file = tmp_path / "ws/src/nodes/nodes/ask.py"
    for end, status, said in (
        ("return", 0, ""),
        ("return 'no robot'", 1, "[ros2run]: Process exited with failure 1\n"),
        ("raise ValueError", 1, "[ros2run]: Process exited with failure 1\n"),
        ("raise KeyboardInterrupt", INTERRUPTED, "[ros2run]: Interrupt\n"),
    ):
        file.write_text(f"def main(): {end}\n")
        assert workspace("nodes", "ask")[:2] == (status, said)


def test_a_file_of_a_package_finds_the_packages_beside_its_own(workspace, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    script = str(tmp_path / "ws/src/nodes/nodes/ask.py")
    assert workspace(script, "-x", folder="../elsewhere") == (0, _SAID, "")


def test_missing_package_or_executable_is_one_line(workspace):
    for arguments, start in (
        (["nodez", "ask"], "Package 'nodez' not found\n  hint: expected a package.xml"),
        (["rqt_console", "rqt_console"], "Package 'rqt_console' not found\n  hint: taskrpc has no"),
        (["nodes", "asc"], "No executable found\n  hint: nodes has ask; got 'asc'"),
        (["nodes"], "cannot run nodes: No such file or directory; for a package, name its exec"),
    ):
        code, out, error = workspace(*arguments)
        assert (code, out, error.count("\n")) == (1, "", start.count("\n") + 1)
        assert error.startswith(start)


def test_a_compiled_program_is_called_one(workspace, tmp_path):
    (tmp_path / "ws/src/nodes/CMakeLists.txt").write_text("add_executable(wave src/wave.cpp)\n")
    code, _, error = workspace("nodes", "wave")
    needs = "taskrpc runs Python programs; C++ programs, rqt, RViz and Gazebo need a real ROS 2\n"
    assert code == 1
    assert error == f"No executable found\n  hint: wave of nodes is a C++ program: {needs}"
    assert workspace("nodes", "wafe")[2].endswith(f"nodes has ask; got 'wafe'; {needs}")


def test_executables_of_packages_that_taskrpc_contains_run(workspace, tmp_path):
    code, out, error = workspace("demo_nodes_py", "tolker")
    assert (code, out) == (1, "")
    assert "demo_nodes_py has add_two_ints_client, add_two_ints_server, listener, talker" in error
    source = "import demo_nodes_py.topics.talker as own; print(own.Talker.__module__)"
    (tmp_path / "ws/src/nodes/nodes/ask.py").write_text(f"def main(): {source}\n")
    assert workspace("nodes", "ask")[:2] == (0, "demo_nodes_py.topics.talker\n")


def test_package_with_sources_in_a_subfolder_runs(workspace, tmp_path):
    package = tmp_path / "ws" / "src" / "inner"
    (package / "src" / "inner").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>inner</name></package>")
    (package / "setup.py").write_text(
        "setup(package_dir={'': 'src'},"
        " entry_points={'console_scripts': ['tell = inner.tell:main']})"
    )
    (package / "src" / "inner" / "__init__.py").touch()
    (package / "src" / "inner" / "tell.py").write_text(
        "from inner import __name__ as own\nfrom my_things.srv import Ask\n"
        "def main(): print(own, Ask.Request(a=1))\n"
    )
    (tmp_path / "ws/src/nodes/nodes/ask.py").write_text("import inner.tell\ninner.tell.main()\n")
    said = "inner my_things.srv.Ask_Request(a=1)\n"
    assert workspace("inner", "tell") == (0, said, "")
    assert workspace("src/nodes/nodes/ask.py") == (0, said, "")


@pytest.mark.skipif(shutil.which("env") is None, reason="there is no env here")
def test_a_prefix_goes_before_the_program(workspace, tmp_path):
    prefix = ("--prefix", "env GREETING='hi there'")
    (tmp_path / "ws" / "program.py").write_text(
        "import os, sys\nprint(os.environ['GREETING'], sys.argv[1:])\nsys.exit(4)\n"
    )
    assert workspace(*prefix, "program.py", "-x") == (4, "hi there ['-x']\n", "")
    assert workspace(*prefix, "nodes", "ask", "-x") == (3, _SAID + _FAILED, "")
    code, _, error = workspace("--prefix", "env '", "program.py")
    assert (code, error) == (2, "--prefix: expected a command, got env ': No closing quotation\n")


def test_modules_are_imported_by_the_names_that_their_packages_install(workspace, tmp_path):
    source = tmp_path / "ws" / "src"
    for path, text in {
        "lights/package.xml": "<package><name>lights</name></package>",
        "lights/CMakeLists.txt": (
            "project(lights)\nament_python_install_package(lamp_tools PACKAGE_DIR python/lib)\n"
            "install(DIRECTORY plain/ DESTINATION ${PYTHON_INSTALL_DIR}/plain_lamps)\n"
            "install(FILES one.py DESTINATION ${PYTHON_INSTALL_DIR}/spread RENAME two.py)\n"
            "install(PROGRAMS nodes/shine.py DESTINATION lib/${PROJECT_NAME} RENAME shine)\n"
        ),
        "lights/python/lib/__init__.py": "",
        "lights/python/lib/glow.py": "from . import __name__ as name\n",
        "lights/plain/bulb.py": "",
        "lights/one.py": "",
        "lights/nodes/shine.py": "import nodes.ask\nnodes.ask.main()\n",
        "kit/package.xml": "<package><name>kit</name></package>",
        "kit/setup.py": "setup(packages=['other'], package_dir={'third': 'lib/x'})",
        "kit/other/__init__.py": "",
        "kit/lib/x/__init__.py": "",
        "nodes/nodes/ask.py": (
            "import lamp_tools.glow, plain_lamps.bulb, spread.two, other, third\n"
            "def main():\n"
            "    print(lamp_tools.glow.name, plain_lamps.bulb.__name__, spread.two.__name__)\n"
        ),
    }.items():
        file = source / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    said = "lamp_tools plain_lamps.bulb spread.two\n"
    assert workspace("lights", "shine") == (0, said, "")
