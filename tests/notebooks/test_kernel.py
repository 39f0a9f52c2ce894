"""Cells in a real kernel: run twice, interrupted, restarted, in two notebooks at once."""

import os
import re
import sys
import time
from pathlib import Path

import pytest

pytestmark = [pytest.mark.notebooks, pytest.mark.real_time]
pytest.importorskip("ipykernel", reason="the extra `notebooks` is not installed")

from tests.docs.markdown import read_page  # noqa: E402
from tests.notebooks.kernel import Kernel  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "work-in-a-notebook.md"
BEGIN = "%load_ext taskrpc.course.notebook\nfrom taskrpc.course import notebook"
SERVER = """
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node

class Server(Node):
    def __init__(self):
        super().__init__("NAME")
        self.create_service(AddTwoInts, "add", self.add)

    def add(self, request, response):
        if request.b < 0:
            raise ValueError("b is negative")
        response.sum = request.a + OFFSET
        return response

rclpy.init()
server = Server()
notebook.spin(server)
"""
CLIENT = """
rclpy.init()
asking = rclpy.create_node("asking")
client = asking.create_client(AddTwoInts, "add")
assert client.wait_for_service(30)
future = client.call_async(AddTwoInts.Request(a=2))
rclpy.spin_until_future_complete(asking, future, timeout_sec=30)
print(future.result().sum)
"""
BLOCKING = """
import srvgen, taskrpc.sync
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
def add(request, response):
    response.sum = request.a + OFFSET
    return response
node = taskrpc.sync.Node("blocking").start()
service = node.create_service(AddTwoInts, "add", add)
print(node.create_client(AddTwoInts, "add").call(AddTwoInts.Request(a=2)).sum)
"""
ASYNCHRONOUS = """
import srvgen, taskrpc
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
def add(request, response):
    response.sum = request.a + OFFSET
    return response
node = taskrpc.Node("asynchronous")
await node.start()
service = node.create_service(AddTwoInts, "add", add)
print((await node.create_client(AddTwoInts, "add").call(AddTwoInts.Request(a=2))).sum)
"""


@pytest.fixture
def runtime(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture
def new_kernel(tmp_path, runtime):
    kernels = []

    def start(**environment):
        kernels.append(Kernel(tmp_path, runtime, **environment))
        return kernels[-1]

    yield start
    for kernel in kernels:
        kernel.close()


@pytest.fixture
def kernel(new_kernel):
    kernel = new_kernel()
    kernel.good(BEGIN)
    return kernel


def server(name, offset):
    return SERVER.replace("NAME", name).replace("OFFSET", str(offset))


def test_cell_that_runs_again_replaces_its_node(kernel):
    kernel.good(server("adder", 0), "a")
    assert kernel.good(CLIENT, "b") == "2\n"
    kernel.good(server("adder", 10), "a")
    assert kernel.good(CLIENT, "b") == "12\n"
    kernel.good(server("renamed", 20), "a")
    assert kernel.good(CLIENT, "b") == "22\n"
    kernel.good(server("renamed", 30), "another cell")
    assert kernel.good(CLIENT, "b") == "32\n"
    nodes = kernel.good("!taskrpc node list")
    assert nodes.split() == ["/asking", "/renamed"]


@pytest.mark.parametrize("program", [BLOCKING, ASYNCHRONOUS], ids=["blocking", "asynchronous"])
def test_taskrpcs_own_nodes_are_replaced_too(program, kernel):
    assert kernel.good(program.replace("OFFSET", "0"), "a") == "2\n"
    assert kernel.good(program.replace("OFFSET", "1"), "a") == "3\n"
    renamed = program.replace("OFFSET", "2").replace('Node("', 'Node("new_')
    assert kernel.good(renamed, "a") == "4\n"


def test_shutdown_and_init_begin_anew(kernel):
    kernel.good(server("adder", 0), "a")
    kernel.good("rclpy.shutdown()")
    kernel.good(server("adder", 5), "a")
    assert kernel.good(CLIENT, "b") == "7\n"


def test_interrupted_cell_leaves_the_nodes_alone(kernel):
    kernel.good(server("adder", 0), "a")
    spinning = "other = rclpy.create_node('other')\nprint('now', flush=True)\nrclpy.spin(other)"
    output = kernel.run(spinning, interrupt_at="now")
    assert re.match(r"Cell In\[\d+\], line 3: KeyboardInterrupt: ", output.error), output.error
    assert "notebook.spin(node)" in output.error
    assert kernel.good(CLIENT, "b") == "2\n"


@pytest.mark.parametrize(
    "wait",
    [
        "import taskrpc.sync\nnode = taskrpc.sync.Node('n').start()\nSAY\n"
        "node.create_client(AddTwoInts, 'none').wait_for_service()",
        "import taskrpc\nnode = taskrpc.Node('n')\nawait node.start()\nSAY\n"
        "await node.create_client(AddTwoInts, 'none').wait_for_service()",
    ],
    ids=["blocking", "asynchronous"],
)
def test_interrupted_wait_takes_one_line(wait, kernel):
    kernel.good("from example_interfaces.srv import AddTwoInts")
    code = wait.replace("SAY", "print('now', flush=True)")
    output = kernel.run(code, interrupt_at="now")
    assert "KeyboardInterrupt: the cell was interrupted while it waited" in output.error
    assert output.error.count("\n") == 0


def test_error_of_taskrpc_takes_one_line_and_the_students_own_keeps_its_traceback(kernel):
    output = kernel.run(BLOCKING.replace("OFFSET", "0") + "\nAddTwoInts.Request(1, 2)")
    assert re.fullmatch(
        r"Cell In\[\d+\], line 10: TypeError: \w+ takes its fields by name: .*", output.error
    )
    output = kernel.run("node.create_client(AddTwoInts, 'no name')")
    assert re.match(r"Cell In\[\d+\], line 1: InvalidName: ", output.error)
    assert "Traceback" not in output.error
    assert "Traceback" in kernel.run("1 / 0").error
    assert "Traceback" in kernel.run("len(1)").error


def test_exception_of_a_background_callback_is_printed_and_the_node_continues(kernel):
    kernel.good(server("adder", 0), "a")
    kernel.good("from example_interfaces.srv import AddTwoInts\nimport taskrpc.sync, time")
    output = kernel.run(
        "node = taskrpc.sync.Node('n').start()\nclient = node.create_client(AddTwoInts, 'add')\n"
        "try:\n    client.call(AddTwoInts.Request(b=-1))\n"
        "except taskrpc.HandlerFailed as error:\n    print('failed', error)\n"
        "time.sleep(1)\n"
        "print(client.call(AddTwoInts.Request(a=2)).sum)"
    )
    assert "b is negative" in output.text
    assert output.text.endswith("2\n")
    assert "The node continues." in output.text
    assert re.search(r'File "Cell In\[\d+\]", line \d+, in add', output.text)
    assert "site-packages" not in output.text.partition("Traceback")[2]


def test_restarted_kernel_leaves_nothing(kernel, new_kernel):
    kernel.good(server("adder", 0), "a")
    kernel.restart()
    other = new_kernel()
    other.good(BEGIN)
    assert other.good("!taskrpc node list", "x").split() == []


def test_two_notebooks_call_each_other_and_name_each_other(kernel, new_kernel):
    kernel.good(server("adder", 7), "a")
    other = new_kernel(JPY_SESSION_NAME="/home/ana/lab2.ipynb")
    other.good(BEGIN)
    other.good("import rclpy\nfrom example_interfaces.srv import AddTwoInts")
    assert other.good(CLIENT) == "9\n"
    error = other.run("asking.create_service(AddTwoInts, 'add', None)").error
    assert "NameInUse: /add is already offered by a notebook (pid " in error
    other.good("asking.create_service(AddTwoInts, 'mine', None)")
    error = kernel.run("server.create_service(AddTwoInts, 'mine', None)").error
    assert "is already offered by notebook lab2.ipynb (pid " in error


PROGRAM = """
%%writefile lab1/NAME.py
import os, sys, time
import rclpy
rclpy.init()
print(os.getpid(), sys.argv[1:], flush=True)
node = rclpy.create_node("NAME")
rclpy.spin(node)
"""
WAIT = "\n!for i in $(seq 100); do taskrpc node list | grep -q server && break; done; sleep 0.5"
"""Waits in a cell until `server.py` runs, so that the cell shows what it has printed."""


def nodes(kernel):
    return kernel.good("!taskrpc node list").split()


def program_ids(text):
    return [int(found) for found in re.findall(r"^(\d+) \[", text, flags=re.M)]


def wait_for_end(process):
    for _ in range(200):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    raise AssertionError("the program still runs")


def test_program_runs_in_the_background_until_it_is_started_again_or_stopped(kernel):
    kernel.good("notebook.lab(1)\n")
    kernel.good(PROGRAM.replace("NAME", "server").lstrip())
    first = program_ids(kernel.good(f"notebook.start('server.py', 1){WAIT}"))
    assert nodes(kernel) == ["/server"]
    second = program_ids(kernel.good(f"notebook.start('server.py', 2){WAIT}"))
    wait_for_end(first[0])
    assert nodes(kernel) == ["/server"]
    kernel.good("notebook.stop('server.py')")
    wait_for_end(second[-1])
    assert nodes(kernel) == []


def test_program_ends_with_a_killed_kernel(kernel):
    kernel.good("notebook.lab(1)")
    kernel.good(PROGRAM.replace("NAME", "server").lstrip())
    output = kernel.good(f"notebook.start('server.py'){WAIT}")
    [process] = program_ids(output)
    kernel.restart()
    wait_for_end(process)


def test_interrupt_ends_a_program_in_the_foreground_only(kernel):
    kernel.good("notebook.lab(1)")
    for name in ("server", "client"):
        kernel.good(PROGRAM.replace("NAME", name).lstrip())
    server = program_ids(kernel.good(f"notebook.start('server.py'){WAIT}"))
    output = kernel.run("notebook.run('client.py', 2, 3)", interrupt_at="['2', '3']")
    [client] = [each for each in program_ids(output.text) if each not in server]
    assert "KeyboardInterrupt: the cell was interrupted while it waited" in output.error
    wait_for_end(client)
    assert nodes(kernel) == ["/server"]


def test_magic_without_a_lab_says_what_to_do(kernel):
    error = kernel.run("%%lab server.py\nx = 1").error
    assert "run its first cell, which calls notebook.lab(1)" in error
    assert "\n" not in error


def test_mistake_in_a_file_of_the_lab_is_shown_with_its_line(kernel):
    kernel.good("notebook.lab(1)")
    error = kernel.run("%%lab server.py\nx = 1\n1 / 0").error
    assert "lab1/server.py:2" in error
    assert "taskrpc" not in error
    error = kernel.run("%%lab server.py\nx = 1\ny = = 2").error
    assert "lab1/server.py:2" in error
    assert "taskrpc" not in error
    error = kernel.run("%%lab my_things/srv/Word.srv\nint x\n---").error
    assert "did you mean int32?" in error


def test_picture_follows_the_robot(kernel):
    kernel.good("notebook.start_robot(speed=20)", "r")
    kernel.good("notebook.start_robot(speed=20)", "r")
    kernel.good(
        "import srvgen, taskrpc.sync\n"
        "RobotTask = srvgen.load('my_robot_interfaces/srv/RobotTask')\n"
        "node = taskrpc.sync.Node('n').start()\ntasks = node.create_client(RobotTask, 'robot_task')"
    )
    output = kernel.run(
        "tasks.call(RobotTask.Request(task_type='move', target='warehouse', priority=5))\n"
        "notebook.view(seconds=3)"
    )
    [picture] = output.pictures
    assert output.updates > 1
    assert "<svg" in picture["text/html"]
    assert "/robot_task: idle, no task waits" in picture["text/plain"]
    assert "/n -> /robot_task  OK" in picture["text/plain"]
    kernel.good("notebook.view()", "v")
    kernel.good("notebook.stop_robot()")
    [picture] = kernel.run("notebook.view()", "v").pictures
    assert picture["text/plain"].startswith("no task server is running")


def test_kernel_that_shows_a_robot_ends_quietly(kernel):
    kernel.good("notebook.start_robot()\nnotebook.view()")
    assert kernel.good("import os\nos.getpid()") == ""


def test_page_is_true(kernel):
    blocks = [block.text for block in read_page(PAGE).blocks if block.kind == "python"]
    assert len(blocks) == 8
    printed = [kernel.good(text, f"cell {number}") for number, text in enumerate(blocks)]
    assert printed[2] == "5\n"
    assert printed[3] == "42\n"
    assert printed[5].endswith("Task queued: move\n")
    assert printed[6:] == ["2\n", "4\n"]


@pytest.mark.skipif(sys.platform == "win32", reason="the terminal's IPython is tried on POSIX only")
def test_module_works_without_a_kernel(tmp_path, runtime):
    import subprocess

    code = "from taskrpc.course import notebook\nnotebook.start_robot()\nnotebook.view()\n"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout.splitlines()[0] == "/robot_task: idle, no task waits"
    assert (done.returncode, done.stderr) == (0, "")
