"""Where ROS 2 hangs in silence we say so in one line; with --like-ros we do what ROS 2 does."""

import sys

import pytest

from tests.ros.packages.rclpy._impl.diagnostics.sources import HEAD, SOONER, told

pytestmark = pytest.mark.real_time

NOTHING = """
node.create_service(AddTwoInts, "add", lambda request, response: None)
client = node.create_client(AddTwoInts, "add")
future = client.call_async(REQUEST)
try:
    rclpy.spin_until_future_complete(node, future, timeout_sec=1)
except TypeError:
    print("TypeError")
rclpy.spin_until_future_complete(node, future, timeout_sec=0.5)
print(future.done())
"""

RAISES = NOTHING.replace("response: None", "response: 1 / 0").replace(
    "TypeError", "ZeroDivisionError"
)

TWO = """
ran = []
def server(number):
    def answer(request, response):
        ran.append(number)
        response.sum = number
        return response
    return answer
node.create_service(AddTwoInts, "add", server(1))
node.create_service(AddTwoInts, "add", server(2))
answer = ask("add")
rclpy.spin_once(node, timeout_sec=0.2)
print(sorted(ran))
"""

NOBODY = (
    SOONER
    + """
future = ask("nobody", 0.8)
node.create_service(AddTwoInts, "nobody", add)
rclpy.spin_until_future_complete(node, future, timeout_sec=1)
print(future.done())
"""
)

DEPTH = """
node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")
client.wait_for_service()
futures = [client.call_async(REQUEST) for _ in range(20)]
time.sleep(0.5)
for _ in range(50):
    rclpy.spin_once(node, timeout_sec=0.01)
print(sum(future.done() for future in futures))
"""

WRAP = """
def load(request, response):
    response.result = 257
    return response
node.create_service(LoadMap, "load", load)
future = node.create_client(LoadMap, "load").call_async(LoadMap.Request())
try:
    rclpy.spin_until_future_complete(node, future, timeout_sec=2)
    print(future.result().result)
except Exception as error:
    print(type(error).__name__)
"""

MISMATCH = (
    SOONER
    + """
node.create_service(AddTwoInts, "add", add)
client = node.create_client(LoadMap, "add")
print(client.wait_for_service(0.2))
print(client.service_is_ready())
future = client.call_async(LoadMap.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=1)
print(future.done())
"""
)

CASES = {
    "a forgotten return": (
        NOTHING,
        "never answer this call",
        "TypeError\nTrue\n",
        "TypeError\nFalse\n",
    ),
    "a raise in a callback": (
        RAISES,
        "leave the caller waiting for ever",
        "ZeroDivisionError\nTrue\n",
        "ZeroDivisionError\nFalse\n",
    ),
    "two servers of one name": (TWO, "let both servers of /add run", "[1]\n", "[1, 2]\n"),
    "a service without a server": (NOBODY, "lose this request", "True\n", "False\n"),
    "more than ten in flight": (DEPTH, "drop the oldest of more than 10", "20\n", "10\n"),
    "a service of another type": (
        MISMATCH,
        "is for nav_msgs/srv/LoadMap, but /add is offered as example_interfaces/srv/AddTwoInts",
        "False\nFalse\nFalse\n",
        "False\nFalse\nFalse\n",
    ),
    "a number too large": (WRAP, "send nav_msgs.srv.LoadMap_Response", "InvalidRequest\n", "1\n"),
}


PARAMETERS = """
from rclpy.action import ActionServer
from example_interfaces.action import Fibonacci
def greet(request):
    return request
node.create_service(AddTwoInts, "add", greet)
node.create_service(AddTwoInts, "other", lambda *args: args[1])
node.create_timer(60, greet)
node.create_timer(60, print)
node.create_guard_condition(greet)
ActionServer(node, Fibonacci, "count", lambda: None)
ActionServer(node, Fibonacci, "again", greet, goal_callback=greet, cancel_callback=greet)
print("made")
"""
SHOWN = [
    "callback of /add: expected a function that takes a request, a response, got greet(request)",
    "the callback of a timer: expected a function that takes nothing, got greet(request)",
    "the callback of a guard condition: expected a function that takes nothing, got greet(request)",
    "execute_callback: expected a function that takes a goal handle, got <lambda>()",
]


@pytest.mark.end_to_end
def test_callbacks_with_other_parameters_are_explained_when_they_are_given(ros, monkeypatch):
    explained = ros(HEAD + PARAMETERS)
    monkeypatch.setenv("TASKRPC_LIKE_ROS", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", "99")
    silent = ros(HEAD + PARAMETERS, name="like_ros.py")
    explained.end()
    silent.end()
    assert (explained.out, silent.out) == ("made\n", "made\n")
    said = told(explained.err)
    assert len(said) == len(SHOWN)
    for line, shown in zip(said, SHOWN, strict=True):
        assert shown in line
        assert ".py:" in line
    assert told(silent.err) == []


QUICK = ("a forgotten return", "two servers of one name", "a number too large")
"""Cases of the quick suite; the others wait for seconds."""


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.faults) for name in CASES],
)
def test_silent_mistakes_are_explained_and_happen_with_like_ros(ros, monkeypatch, name):
    """Both programs wait most of the time, so they run side by side, in two domains."""
    source, line, kind, like = CASES[name]
    explained = ros(HEAD + source)
    monkeypatch.setenv("TASKRPC_LIKE_ROS", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", "99")
    silent = ros(HEAD + source, name="like_ros.py")
    explained.end()
    assert (explained.out, "never retrieved" in explained.err) == (kind, False)
    assert len([each for each in told(explained.err) if line in each]) == 1
    silent.end()
    assert silent.out == like
    assert told(silent.err) == []


@pytest.mark.end_to_end
@pytest.mark.parametrize(("like", "out"), [("0", "TimeoutError\n"), ("1", "None\n")])
def test_like_ros_a_call_has_no_result_after_its_timeout(run, monkeypatch, like, out):
    monkeypatch.setenv("TASKRPC_LIKE_ROS", like)
    source = """
try:
    print(node.create_client(AddTwoInts, "nobody").call(REQUEST, timeout_sec=0.3))
except TimeoutError:
    print("TimeoutError")
"""
    assert run(HEAD + source)[:2] == (0, out)


@pytest.mark.end_to_end
@pytest.mark.skipif(sys.platform == "win32", reason="no process gets just a Ctrl-C there")
@pytest.mark.parametrize(("like", "code"), [("0", 0), ("1", 1)])
def test_like_ros_the_shutdown_after_ctrl_c_raises(ros, monkeypatch, like, code):
    monkeypatch.setenv("TASKRPC_LIKE_ROS", like)
    source = """
try:
    print("up")
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
rclpy.shutdown()
"""
    program = ros(HEAD + source)
    program.wait_for("up")
    assert program.interrupt() == code
    said = "RCLError: failed to shutdown: rcl_shutdown already called on the given context"
    assert (said in program.err) == bool(code)


def test_a_callback_interrupted_by_the_shutdown_is_not_reported(run):
    source = """
from rclpy.executors import ExternalShutdownException
def interrupted(request, response):
    rclpy.shutdown()
    raise ExternalShutdownException
node.create_service(AddTwoInts, "add", interrupted)
try:
    ask("add")
except ExternalShutdownException:
    print("over")
"""
    assert run(HEAD + source) == (0, "over\n", "")


@pytest.mark.faults
def test_a_dead_server_is_reported_and_with_like_ros_its_call_never_ends(ros, run, monkeypatch):
    server = HEAD + (
        "import os\nnode.create_service(AddTwoInts, 'add', lambda *_: os._exit(3))\n"
        "print('ready', flush=True)\nrclpy.spin(node)"
    )
    client = HEAD.replace('Node("n")', 'Node("caller")') + (
        "node.create_client(AddTwoInts, 'add').wait_for_service()\nprint(ask('add').done())"
    )
    for like, done, lines in (("0", "True\n", 1), ("1", "False\n", 0)):
        monkeypatch.setenv("TASKRPC_LIKE_ROS", like)
        ros(server, name="server.py").wait_for("ready")
        _, out, err = run(client)
        assert (out, len(told(err))) == (done, lines)


@pytest.mark.faults
def test_a_name_that_another_program_offers_is_refused_and_like_ros_offered_twice(
    ros, run, monkeypatch
):
    server = "node.create_service(AddTwoInts, 'add', add)\nprint('ready', flush=True)\n"
    for like, code, lines in (("0", 1, 1), ("1", 0, 0)):
        monkeypatch.setenv("TASKRPC_LIKE_ROS", like)
        first = ros(HEAD + server + "rclpy.spin(node)", name="server.py")
        first.wait_for("ready")
        second, out, err = run(HEAD + server)
        assert (second, "ready" in out, "NameInUse" in err) == (code, code == 0, code == 1)
        assert len([line for line in told(err) if "both servers of /add" in line]) == lines
        assert ("--ros-args -r __ns:=/second" in err) == (code == 1)
        first.kill()


@pytest.mark.faults
def test_like_ros_two_programs_that_offer_one_name_both_run_each_request(ros, run, monkeypatch):
    monkeypatch.setenv("TASKRPC_LIKE_ROS", "1")
    offer = "node.create_service(AddTwoInts, 'add', lambda *both: print('runs') or add(*both))\n"
    source = HEAD + offer + "print('ready')\nrclpy.spin(node)"
    servers = [ros(source, name=f"server{number}.py") for number in range(2)]
    for server in servers:
        server.wait_for("ready")
    caller = HEAD.replace('Node("n")', 'Node("caller")') + (
        "node.create_client(AddTwoInts, 'add').wait_for_service()\n"
        "for _ in range(2):\n    print(ask('add', 10).result().sum)\n"
    )
    assert run(caller) == (0, "3\n3\n", "")
    for server in servers:
        server.wait_for("runs", times=2)
