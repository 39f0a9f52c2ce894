"""`taskrpc graduate` tells what a real ROS 2 would do differently, where, and how to mend it."""

import json

import pytest

from taskrpc.cli.main import main

NODE = """import time
import rclpy
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int8
from rclpy.node import Node
import threading


class Adder(Node):
    def __init__(self):
        super().__init__("adder")
        self.client = self.create_client(AddTwoInts, "add")
        while not self.client.wait_for_service(timeout_sec=1.0):
            pass
        {setup}

{methods}

def main():
    rclpy.init()
    node = Adder()
    {main}
    rclpy.shutdown()


if __name__ == "__main__":
    main()
"""
TIMER = "self.create_timer(1.0, self.tick)"
SERVICE = 'self.create_service(AddTwoInts, "sum", self.add)'
REQUEST = "AddTwoInts.Request(a=1, b=2)"


def _method(head, *lines):
    body = "".join(f"        {line}\n" for line in lines)
    return f"    {head}\n{body}"


def _program(setup="pass", methods="", main="rclpy.spin(node)"):
    return NODE.format(setup=setup, methods=methods, main=main)


@pytest.fixture
def graduate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def graduate(text, name="program.py"):
        (tmp_path / name).write_text(text)
        code = main(["graduate", name])
        printed = capsys.readouterr()
        assert printed.err == ""
        lines = printed.out.splitlines()
        assert code == (0 if lines[0].startswith("nothing found") else 1)
        return [] if code == 0 else lines

    return graduate


HELPED = _method("def tick(self):", "self.ask()") + _method(
    "def ask(self):", f"return self.client.call({REQUEST})"
)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (_program(TIMER, HELPED), "self.client.call inside a callback (tick > ask); ROS 2 hangs"),
        (
            _program(
                TIMER,
                _method(
                    "def tick(self):",
                    f"f = self.client.call_async({REQUEST})",
                    "rclpy.spin_until_future_complete(self, f)",
                ),
            ),
            "spin_until_future_complete inside a callback (tick); ROS 2 hangs, or",
        ),
        (
            _program(
                main="try:\n        def tick():\n            time.sleep(5)\n"
                "        node.create_timer(1.0, tick)\n    finally:\n        rclpy.spin(node)"
            ),
            "sleep inside a callback (tick); ROS 2 runs no other callback",
        ),
        (
            _program(TIMER, _method("def tick(self):", "time.sleep(5)")),
            "sleep inside a callback (tick); ROS 2 runs no other callback",
        ),
        (
            _program(main=f"node.client.call({REQUEST})").replace("node.client", "self.client"),
            "self.client.call while no other thread spins; ROS 2 waits for ever",
        ),
        (
            _program(
                main="for n in range(50): self.client.call_async(AddTwoInts.Request(a=n))\n"
                "    rclpy.spin(node)"
            ),
            "call_async in a loop that does not wait; ROS 2 keeps 10 requests",
        ),
        (
            _program(
                main=f"print(self.client.call_async({REQUEST}).result())\n    rclpy.spin(node)"
            ),
            "result() of a call that has just been sent; it is None",
        ),
        (
            _program(main=f"f = self.client.call_async({REQUEST})\n    while not f.done(): pass"),
            "a loop until a future is done, without a spin in it; ROS 2 never leaves it",
        ),
        (
            _program(main=f"self.client.call_async({REQUEST})"),
            "call_async in a program that never spins; ROS 2 never takes the answer",
        ),
        (
            _program(SERVICE, _method("def add(self, request, response):", "response.sum = 1")),
            "add can end without return response; the server ends with an error",
        ),
        (
            _program(
                SERVICE,
                _method(
                    "def add(self, request, response):", "if request.a:", "    return response"
                ),
            ),
            "add can end without return response",
        ),
        (
            _program(SERVICE, _method("def add(self, request, response):", "return True")),
            "add returns True; the server ends with an error",
        ),
        (
            _program(
                SERVICE,
                _method("def add(self, request, response):", "raise ValueError('no')"),
            ),
            "a raise in a service callback; the server ends with an error",
        ),
        (
            _program(f"{SERVICE}; {SERVICE}", _method("def add(self, q, r):", "return r")),
            "a second server of 'sum'; both run each request",
        ),
        (
            _program(main=f"self.client.call_async({REQUEST}, retry=3)\n    rclpy.spin(node)"),
            "call_async(retry=...); rclpy does not know the argument: TypeError; repeat only what",
        ),
        (
            _program().replace("import time", "import taskrpc"),
            "taskrpc is imported; ROS 2 does not have it",
        ),
        (
            _program(main="rclpy.spin(node)").replace("    rclpy.shutdown()\n", ""),
            "rclpy.init() without rclpy.shutdown()",
        ),
        (
            _program().replace("    rclpy.init()\n", ""),
            "rclpy is used without rclpy.init(); ROS 2 raises NotInitializedException",
        ),
        (_program().replace('"adder"', '"my adder"'), "the name 'my adder'; ROS 2 refuses it: "),
        (_program().replace('"add"', '"add-two"'), "the name 'add-two'; ROS 2 refuses it: "),
        (_program(main="Int8(data=300)"), "300 for the int8 data; ROS 2 refuses it, or wraps"),
        (
            _program(main="q = AddTwoInts.Request()\n    q.a = 2.5"),
            "2.5 for the int64 a; ROS 2 refuses it, or sends something else; write an int",
        ),
        (
            _program(SERVICE, _method("def add(self, q, r):", "r.sum = 'x'", "return r")),
            "'x' for the int64 sum",
        ),
        (_program(main="cmd = 'ros2 service list --json'"), "--json; ros2's commands do not"),
        (
            _program().replace("while not self.client.wait_for_service(timeout_sec=1.0):", "if 1:")
            + f"\nself.client.call_async({REQUEST})\n",
            "self.client calls without wait_for_service; a request that ROS 2 sends",
        ),
    ],
)
def test_what_ros_does_differently_is_told(graduate, text, what):
    found = graduate(text)
    assert [line for line in found if what in line], found
    assert all(line.startswith("program.py:") for line in found)


def test_a_finding_stands_where_it_is_and_says_what_to_do(graduate):
    text = _program(TIMER, _method("def tick(self):", f"self.client.call({REQUEST})"))
    line = 1 + text[: text.index("self.client.call(")].count("\n")
    assert graduate(text) == [
        f"program.py:{line}:9: self.client.call inside a callback (tick);"
        " ROS 2 hangs: the thread that should take the answer waits for it;"
        " use await call_async(...) in an async def callback, or add_done_callback"
    ]


ANSWERS = _method(
    "def add(self, request, response):",
    "try:",
    "    if request.a < 0:",
    "        raise ValueError",
    "    response.sum = request.a + request.b",
    "    return response",
    "except ValueError:",
    "    response.sum = -1",
    "return response",
)
AWAITS = _method("async def tick(self):", f"await self.client.call_async({REQUEST})")
WAITS = (
    f"for n in range(50):\n        f = self.client.call_async({REQUEST})\n"
    "        rclpy.spin_until_future_complete(node, f)"
)
OVERLAPS = (
    "from rclpy.executors import MultiThreadedExecutor\n"
    "from rclpy.callback_groups import ReentrantCallbackGroup\n"
)


@pytest.mark.parametrize(
    "text",
    [
        _program(),
        _program(SERVICE, ANSWERS),
        _program(TIMER, AWAITS),
        _program(main=WAITS),
        _program(main=f"[self.client.call_async({REQUEST}) for n in range(10)]; rclpy.spin(node)"),
        _program(
            main="threading.Thread(target=rclpy.spin, args=(node,)).start()\n"
            f"    self.client.call({REQUEST})"
        ),
        OVERLAPS
        + _program(
            "self.create_timer(1.0, self.tick, callback_group=ReentrantCallbackGroup())",
            HELPED,
            "MultiThreadedExecutor().spin()",
        ),
        _program(
            main="threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()\n"
            f"    self.client.call_async({REQUEST}).add_done_callback(print)"
        ),
        _program(main="Int8(data=127)"),
        "print('no ROS at all')\n",
    ],
)
def test_a_program_that_does_the_same_there_has_no_findings(graduate, text):
    assert graduate(text) == []


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


def test_a_package_is_asked_for_its_dependencies_and_entry_points(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    package = ["pkg", "create", "adder", "--build-type", "ament_python", "--node-name", "one"]
    main([*package, "--dependencies", "rclpy"])
    (tmp_path / "adder" / "adder" / "two.py").write_text(_program())
    capsys.readouterr()
    assert main(["graduate", "adder"]) == 1
    manifest = tmp_path / "adder" / "package.xml"
    told = capsys.readouterr().out.splitlines()
    assert [line.partition("; ")[0] for line in told] == [
        f"{manifest}:1:1: example_interfaces is imported, and not named here",
        f"{manifest}:1:1: std_msgs is imported, and not named here",
        told[2].partition("; ")[0],
    ]
    assert "adder.two has a main and no entry point in setup.py; ros2 run does" in told[2]


@pytest.fixture
def packages(tmp_path, monkeypatch, capsys):
    """A Python package and one of definitions, that colcon builds; asks graduate about them."""
    monkeypatch.chdir(tmp_path)
    main(["pkg", "create", "adder", "--build-type", "ament_python", "--node-name", "one"])
    (tmp_path / "things" / "srv").mkdir(parents=True)
    (tmp_path / "things" / "srv" / "Ask.srv").write_text("---\n")
    main(["export", "colcon", "ws", "--from", "."])
    capsys.readouterr()
    manifest = tmp_path / "ws" / "src" / "things" / "package.xml"
    depends = "<exec_depend>rclpy</exec_depend>\n  <member_of_group>"
    manifest.write_text(manifest.read_text().replace("<member_of_group>", depends))

    def ask():
        code = main(["graduate", "ws/src"])
        lines = capsys.readouterr().out.splitlines()
        assert code == (lines != ["nothing found that a real ROS 2 would do differently"])
        return lines

    ask.folder = tmp_path / "ws" / "src"
    return ask


def test_what_was_created_and_exported_can_be_built(packages):
    assert packages() == ["nothing found that a real ROS 2 would do differently"]


@pytest.mark.parametrize(
    ("path", "old", "new", "said"),
    [
        ("adder/setup.py", None, "", "an ament_python package without setup.py; colcon cannot"),
        ("adder/setup.cfg", "install_scripts", "x", "setup.cfg does not say where executables"),
        ("adder/resource/adder", None, "", "there is no file resource/adder; ros2 does not know"),
        ("adder/package.xml", "<build_type>ament_python</build_type>", "", "there is no build_"),
        ("adder/package.xml", None, "", "there is no package.xml beside it; colcon builds no"),
        ("adder/launch/all.launch.py", "", "x = 1", "the folder launch is not installed; get_"),
        ("things/CMakeLists.txt", '"srv/Ask.srv"', "", "srv/Ask.srv is not built; its import is"),
        ("things/srv/New.srv", "", "---", "srv/New.srv is not built; its import is an Import"),
        ("things/package.xml", "rosidl_interface_packages", "x", "a package of definitions that"),
        (
            "things/scripts/ask.py",
            "",
            "import rclpy",
            "scripts/ask.py is not installed; ros2 run does",
        ),
    ],
)
def test_what_colcon_or_ros2_would_miss_is_told(packages, path, old, new, said):
    file = packages.folder / path
    if old is None:
        file.unlink()
    else:
        file.parent.mkdir(exist_ok=True)
        text = file.read_text() if file.exists() else ""
        file.write_text(text.replace(old, new) if old else new)
    (told,) = packages()
    assert f":1:1: {said}" in told


def test_scripts_and_folders_that_cmake_installs_are_fine(packages):
    things = packages.folder / "things"
    (things / "scripts").mkdir()
    (things / "config").mkdir()
    (things / "scripts" / "ask.py").write_text("import rclpy\n")
    (things / "scripts" / "helper.py").write_text("# whatever import rclpy says\n")
    (things / "config" / "a.yaml").write_text("x: 1\n")
    text = (things / "CMakeLists.txt").read_text()
    for line in (
        "install(DIRECTORY scripts config DESTINATION share/${PROJECT_NAME})",
        "install(PROGRAMS scripts/ask.py DESTINATION lib/x)\n"
        "install(DIRECTORY config DESTINATION x)",
    ):
        (things / "CMakeLists.txt").write_text(f"{text}{line}\n")
        assert packages() == ["nothing found that a real ROS 2 would do differently"]


@pytest.mark.parametrize(
    ("setup_cfg", "setup_py"),
    [
        ("[develop]\nscript-dir=$base/lib/adder\n[install]\ninstall-scripts=$base/lib/adder\n", ""),
        ("", "# options={'install': {'install_scripts': '$base/lib/adder'}}\n"),
    ],
)
def test_where_executables_go_may_be_said_in_other_ways(packages, setup_cfg, setup_py):
    adder = packages.folder / "adder"
    (adder / "setup.cfg").write_text(setup_cfg)
    (adder / "setup.py").write_text((adder / "setup.py").read_text() + setup_py)
    assert packages() == ["nothing found that a real ROS 2 would do differently"]


@pytest.mark.parametrize("text", [None, "def (:\n"])
def test_what_cannot_be_read_is_one_sentence_and_exits_2(tmp_path, capsys, text):
    path = tmp_path / "p.py"
    if text is not None:
        path.write_text(text)
    assert main(["graduate", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
