"""`taskrpc run` runs an unmodified ROS program, and ends as Python would."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.real_time


@pytest.fixture
def run(tmp_path):
    def run(source, *arguments, module=False):
        (tmp_path / "program.py").write_text(source)
        program = ["-m", "program"] if module else ["program.py"]
        done = subprocess.run(
            [sys.executable, "-m", "taskrpc", "run", *program, *arguments],
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
        "__main__ ['-x', '--ros-args', '-r', 'a:=b'] <class 'rclpy.future.Future'>"
        " <class 'std_srvs.srv._set_bool.SetBool_Request'>\n",
        "",
    )


def test_a_package_beside_the_script_is_found_wherever_it_is_started(run, tmp_path):
    folder = tmp_path / "my_things" / "srv"
    folder.mkdir(parents=True)
    (folder / "Ask.srv").write_text("int64 a\n---\nint64 b\n")
    assert run("from my_things.srv import Ask\nprint(Ask.Request(a=2))\n") == (
        0,
        "my_things.srv.Ask_Request(a=2)\n",
        "",
    )


def test_a_program_ends_with_its_own_status(run):
    assert run("import sys\nsys.exit(7)\n")[0] == 7


def test_an_exception_shows_the_program_and_nothing_of_us(run):
    code, _, error = run("def f():\n    1/0\n\nf()\n")
    assert code == 1
    assert error.splitlines()[:2] == [
        "Traceback (most recent call last):",
        '  File "program.py", line 4, in <module>',
    ]
    assert "taskrpc" not in error


def test_a_program_that_is_not_there_is_told_in_a_line(run):
    command = [sys.executable, "-m", "taskrpc", "run"]
    for arguments, line in (
        (["nope.py"], "cannot run nope.py: No such file or directory\n"),
        (["-m", "nope_nope"], "No module named nope_nope\n"),
    ):
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (1, "", line)
