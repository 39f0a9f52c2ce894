"""`taskrpc ros enable` lets plain `python` import rclpy in one environment."""

import os
import subprocess
import venv
from pathlib import Path

import msgspec
import pytest

import taskrpc

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

_CHECKOUT = str(Path(taskrpc.__file__).parent.parent)


class Environment:
    """A virtual environment that has taskrpc through PYTHONPATH."""

    def __init__(self, folder):
        venv.create(folder, symlinks=os.name != "nt")
        self.folder = folder
        self.python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        self.path = os.pathsep.join([_CHECKOUT, str(Path(msgspec.__file__).parents[1])])
        self.cwd = folder

    def run(self, *arguments, **environment):
        """Exit status, stdout and stderr of this environment's Python."""
        unset = ("VIRTUAL_ENV", "PYTHONPATH")
        variables = {name: value for name, value in os.environ.items() if name not in unset}
        done = subprocess.run(
            [self.python, *arguments],
            cwd=self.cwd,
            env={**variables, "PYTHONPATH": self.path, **environment},
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        return done.returncode, done.stdout, done.stderr

    def ros(self, command, **environment):
        return self.run("-m", "taskrpc", "ros", command, **environment)

    @property
    def written(self):
        return sorted(path.name for path in self.folder.rglob("*taskrpc_ros*"))


@pytest.fixture
def environment(tmp_path):
    return Environment(tmp_path / "env")


@pytest.fixture
def enabled(environment):
    code, out, error = environment.ros("enable")
    assert (code, error) == (0, "")
    assert "can import rclpy and interface packages from now on" in out
    return environment


def test_script_imports_rclpy_and_interfaces_in_any_order(enabled, tmp_path):
    folder = tmp_path / "course"
    (folder / "my_things" / "srv").mkdir(parents=True)
    (folder / "my_things" / "srv" / "Ask.srv").write_text("int64 a\n---\nint64 b\n")
    script = folder / "listing.py"
    for imports in (
        "from my_things.srv import Ask; from std_srvs.srv import SetBool; import rclpy",
        "import rclpy; from std_srvs.srv import SetBool; from my_things.srv import Ask",
        "from std_srvs.srv import SetBool; import rclpy.node; from my_things.srv import Ask",
    ):
        script.write_text(f"{imports}\nprint(rclpy.__name__, Ask.Request(a=1), SetBool.Request())")
        said = "rclpy my_things.srv.Ask_Request(a=1) std_srvs.srv.SetBool_Request(data=False)\n"
        assert enabled.run(str(script)) == (0, said, "")
    code = "import rclpy.node, my_things.srv; print(rclpy.node.Node.__module__)"
    enabled.cwd = folder
    assert enabled.run("-c", code) == (0, "rclpy.node\n", "")


def test_program_in_a_workspace_imports_the_other_packages(enabled, tmp_path):
    for name in ("first", "second"):
        package = tmp_path / "ws" / "src" / name / name
        package.mkdir(parents=True)
        (package / "__init__.py").write_text(f"name = '{name}'\n")
        (package.parent / "package.xml").write_text(f"<name>{name}</name>")
    script = tmp_path / "ws" / "src" / "first" / "first" / "main.py"
    script.write_text("import second\nprint(second.name)\n")
    assert enabled.run(str(script)) == (0, "second\n", "")
    enabled.cwd = tmp_path / "ws"  # where ROS would have installed them
    assert enabled.run("-m", "second.__init__") == (0, "", "")
    assert enabled.run("-c", "import first, second; print(first.name)") == (0, "first\n", "")


def test_taskrpc_run_imports_the_same_packages(enabled, tmp_path):
    for package in ("demo", "demo_interfaces"):
        (tmp_path / "src" / package).mkdir(parents=True)
        manifest = tmp_path / "src" / package / "package.xml"
        manifest.write_text(f"<package><name>{package}</name></package>")
    (tmp_path / "src" / "demo_interfaces" / "srv").mkdir()
    (tmp_path / "src" / "demo_interfaces" / "srv" / "Count.srv").write_text("---\nint32 total\n")
    node = tmp_path / "src" / "demo" / "node.py"
    node.write_text("from demo_interfaces.srv import Count\nprint(Count.Response())")
    answer = "demo_interfaces.srv.Count_Response(total=0)\n"
    assert enabled.run("-m", "taskrpc", "run", str(node)) == (0, answer, "")


def test_pytest_runs_tests_of_nodes(enabled, tmp_path):
    folder = tmp_path / "course" / "tests"
    (folder / "my_things" / "msg").mkdir(parents=True)
    (folder / "my_things" / "msg" / "Word.msg").write_text("string word\n")
    (folder / "test_node.py").write_text(
        "from my_things.msg import Word\nimport rclpy\n"
        "def test_node():\n    assert rclpy.__name__ == 'rclpy' and Word(word='a').word == 'a'\n"
    )
    enabled.cwd = folder.parent
    code, out, _ = enabled.run("-m", "pytest", "-q", "-p", "no:cacheprovider")
    assert (code, out.splitlines()[-1].split(" in ")[0]) == (0, "1 passed")


def test_notebook_cell_can_spin_inside_a_running_event_loop(enabled):
    cell = """
import rclpy
from std_srvs.srv import Trigger
with rclpy.init():
    node = rclpy.create_node("notebook")
    node.create_service(Trigger, "ask", lambda request, response: response)
    client = node.create_client(Trigger, "ask")
    assert client.wait_for_service(60)
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future)
    print(future.result().success)
"""
    kernel = f"import asyncio\nasync def kernel(): exec({cell!r}, {{}})\nasyncio.run(kernel())"
    assert enabled.run("-c", kernel) == (0, "False\n", "")


def test_programs_without_ros_load_nothing_of_taskrpc(enabled):
    code = "import sys, json\ntry: import nope_nope\nexcept ImportError as e: print(e)\n"
    code += "print([name for name in sys.modules if name.split('.')[0] in ('taskrpc', 'srvgen')])"
    assert enabled.run("-c", code) == (0, "No module named 'nope_nope'\n[]\n", "")


def test_python_in_a_workspace_starts_with_one_more_module_only(environment):
    code = "import sys; print(len(sys.modules))"
    package = environment.folder / "src" / "arm"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm</name></package>")
    before = int(environment.run("-c", code)[1])
    assert environment.ros("enable")[0] == 0
    assert int(environment.run("-c", code)[1]) == before + 1
    environment.cwd = package  # a program of the package
    assert int(environment.run("-c", code)[1]) == before + 1


def test_disable_removes_everything(enabled):
    assert enabled.run("-c", "import rclpy") == (0, "", "")
    assert enabled.ros("status")[1].startswith("enabled: ")
    [module] = enabled.folder.rglob("_taskrpc_ros.py")
    module.write_text(module.read_text() + "# of another version")
    assert enabled.ros("status")[1].startswith("enabled by another version of taskrpc: ")
    assert enabled.ros("enable")[0] == 0
    assert enabled.ros("status")[1].startswith("enabled: ")
    assert enabled.ros("disable")[0] == 0
    assert enabled.written == []
    assert "No module named 'rclpy'" in enabled.run("-c", "import rclpy")[2]
    assert enabled.ros("disable")[1].startswith("nothing to remove: ")
    assert enabled.ros("status")[1].startswith("not enabled: ")


def test_python_starts_silently_after_taskrpc_was_removed(enabled):
    enabled.path = ""
    assert enabled.run("-c", "print(1)") == (0, "1\n", "")
    code, _, error = enabled.run("-c", "import rclpy")
    assert (code, error.splitlines()[-1]) == (1, "ModuleNotFoundError: No module named 'rclpy'")


def test_real_rclpy_takes_precedence(environment, tmp_path):
    real = tmp_path / "opt" / "rclpy"
    real.mkdir(parents=True)
    (real / "__init__.py").write_text("real = True\n")
    alone = environment.path
    environment.path = os.pathsep.join([alone, str(real.parent)])
    code, out, error = environment.ros("enable")
    assert (code, out, environment.written) == (1, "", [])
    assert error.startswith("programs here already import the rclpy of ROS 2 (")
    assert "import ROS 2's own rclpy" in environment.ros("status")[1]
    environment.path = alone
    assert environment.ros("enable")[0] == 0
    environment.path = os.pathsep.join([alone, str(real.parent)])  # ROS is sourced later
    code = "try:\n import std_srvs.srv\nexcept ImportError: pass\nimport rclpy; print(rclpy.real)"
    assert environment.run("-c", code) == (0, "True\n", "")


def test_foreign_and_read_only_environments_are_refused(environment, tmp_path, monkeypatch):
    code, out, error = environment.ros("enable", VIRTUAL_ENV=str(tmp_path))
    assert (code, out, environment.written) == (1, "", [])
    assert f"but the active environment is {tmp_path}:" in error

    from taskrpc.errors import TaskRpcError
    from taskrpc.ros import environment

    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    (tmp_path / "file").touch()
    monkeypatch.setattr(environment, "folder", lambda: tmp_path / "gone")
    with pytest.raises(TaskRpcError, match=r"cannot write to .*; create your own environment"):
        environment.enable()
