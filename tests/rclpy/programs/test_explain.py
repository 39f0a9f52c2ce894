"""Where ROS 2 hangs in silence we say so in one line; with --like-ros we do what ROS 2 does."""

import sys

import pytest

from tests.rclpy.programs.running import INTERRUPTED

pytestmark = pytest.mark.real_time

HEAD = """
import sys, threading, time
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts
from nav_msgs.srv import LoadMap
REQUEST = AddTwoInts.Request(a=1, b=2)


def add(request, response):
    response.sum = request.a + request.b
    return response


def ask(service, seconds=1.0):
    future = node.create_client(AddTwoInts, service).call_async(REQUEST)
    rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
    return future


rclpy.init()
node = Node("n")
"""

SOONER = """
from rclpy._impl.diagnostics import watchdog as dog
assert (dog._PERIOD, dog._SOON, dog._LATE, dog._STUCK) == (1, 2, 5, 15)
dog._PERIOD, dog._SOON, dog._LATE, dog._STUCK = 0.1, 0.3, 0.5, 0.8
node.handle.bridge.soon(dog._Check().again)  # the first has its second to wait
"""
"""The watchdog need not be waited for as long as users would."""

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

MISMATCH = """
node.create_service(AddTwoInts, "add", add)
client = node.create_client(LoadMap, "add")
print(client.wait_for_service(0.5))
print(client.service_is_ready())
future = client.call_async(LoadMap.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=2.5)
print(future.done())
"""

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


def told(err):
    return [line for line in err.splitlines() if line.startswith("[taskrpc] ROS 2 would ")]


@pytest.mark.parametrize("name", CASES)
def test_silent_mistakes_are_explained_and_happen_with_like_ros(run, monkeypatch, name):
    source, line, kind, like = CASES[name]
    _, out, err = run(HEAD + source)
    assert (out, "never retrieved" in err) == (kind, False)
    assert len([each for each in told(err) if line in each]) == 1
    monkeypatch.setenv("TASKRPC_LIKE_ROS", "1")
    _, out, err = run(HEAD + source)
    assert out == like
    assert told(err) == []


RELAY = """
inner = node.create_client(AddTwoInts, "add"{group})
node.create_service(AddTwoInts, "add", add)

def twice(request, response):
    print("begins", flush=True)
    {wait}
    response.sum = 2 * answer.sum
    return response

node.create_service(AddTwoInts, "twice", twice)
"""
CALL = "answer = inner.call(request)"
SPIN = (
    "future = inner.call_async(request); rclpy.spin_until_future_complete(node, future);"
    " answer = future.result()"
)
OWN = ", callback_group=MutuallyExclusiveCallbackGroup()"
POOL = """
executor = MultiThreadedExecutor(4)
executor.add_node(node)
client = node.create_client(AddTwoInts, "twice", callback_group=ReentrantCallbackGroup())
future = client.call_async(REQUEST)
executor.spin_until_future_complete(future, 3)
print(future.result())
executor.shutdown()
"""
HANGS = {
    "call, one thread": RELAY.format(wait=CALL, group=OWN) + "ask('twice')",
    "call, one group of a pool": RELAY.format(wait=CALL, group="") + POOL,
    "call, the server's group of a pool": RELAY.format(wait=CALL, group=OWN) + POOL,
    "spin, one group": RELAY.format(wait=SPIN, group="") + "ask('twice')",
}


@pytest.mark.parametrize("name", HANGS)
def test_a_callback_that_waits_for_its_own_end_is_refused_and_the_circle_drawn(run, name):
    code, _, err = run(HEAD + HANGS[name])
    # The caller may still be told that his call failed, and why, before the program ends.
    hang = "[taskrpc] ROS 2 would hang here for ever"
    [line] = [each for each in told(err) if each.startswith(hang)]
    assert all(part in line for part in ("twice()", "/add", "async def"))
    assert (code, "WouldDeadlock" in err) == (1, True)


def test_a_deadlock_of_two_nodes_is_shown_in_full_and_its_caller_gets_a_short_error(run):
    source = """
class Asks(Node):
    def __init__(self, name, other):
        super().__init__(name)
        self.create_service(AddTwoInts, name, self.ask)
        self.other = self.create_client(AddTwoInts, other, callback_group=ReentrantCallbackGroup())

    def ask(self, request, response):
        return self.other.call(request)

executor = MultiThreadedExecutor(4)
for each in (node, Asks("a", "b"), Asks("b", "a")):
    executor.add_node(each)
future = node.create_client(AddTwoInts, "a").call_async(REQUEST)
try:
    executor.spin_until_future_complete(future, 5)
except RuntimeError as error:
    print(type(error).__name__)
executor.shutdown()
"""
    _, out, err = run(HEAD + source)
    assert out == "WouldDeadlock\n"
    [line] = [each for each in told(err) if "in a circle" in each]
    assert "(service /b) of /b -> /a -> Asks.ask() (service /a) of /a -> /b -> Asks.ask()" in line


@pytest.mark.parametrize("wait", ["time.sleep(0.1)", "rclpy.spin_once(node, timeout_sec=0.1)"])
def test_a_callback_that_polls_a_future_it_blocks_is_reported(run, wait):
    source = f"""
node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")
def tick():
    future = client.call_async(REQUEST)
    while not future.done() and rclpy.ok():
        {wait}
    sys.exit()
node.create_timer(0.01, tick)
threading.Timer(2, rclpy.shutdown).start()
rclpy.spin(node)
"""
    _, _, err = run(HEAD + SOONER + source)
    asks = "tick() of /n checks repeatedly whether /add has answered"
    assert [asks in line for line in told(err)].count(True) == 1


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


def test_a_program_that_spins_rarely_is_not_reported(run):
    source = """
node.create_service(AddTwoInts, "add", add)
future = node.create_client(AddTwoInts, "add").call_async(REQUEST)
while not future.done():
    time.sleep(3.5)
    rclpy.spin_once(node, timeout_sec=0.01)
print(future.result().sum)
"""
    assert run(HEAD + source) == (0, "3\n", "")


def test_like_ros_a_call_in_a_callback_hangs(ros, monkeypatch):
    monkeypatch.setenv("TASKRPC_LIKE_ROS", "1")
    program = ros(HEAD + RELAY.format(wait=CALL, group=OWN) + "ask('twice'); print('over')")
    program.wait_for("begins")
    with pytest.raises(Exception, match="timed out"):
        program._process.wait(timeout=1)
    assert program.out == "begins\n"


def test_a_call_in_a_callback_of_a_pool_with_groups_of_their_own_is_fine(run):
    source = RELAY.format(wait=CALL, group=OWN).replace('"add", add', f'"add", add{OWN}')
    code, out, err = run(HEAD + source + POOL)
    assert (code, out.endswith("sum=6)\n"), told(err)) == (0, True, [])


def test_an_unspun_call_is_completed_and_reported(run):
    source = """
node.create_service(AddTwoInts, "add", add)
threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
print(Node("m").create_client(AddTwoInts, "add").call(REQUEST).sum)
"""
    code, out, err = run(HEAD + source)
    assert (code, out) == (0, "3\n")
    assert ["no other thread spins /m" in line for line in told(err)] == [True]


def test_a_callback_that_removed_its_node_from_a_pool_is_reported(run):
    source = """
other = Node("other")
other.create_service(AddTwoInts, "add", add)
inner = node.create_client(AddTwoInts, "add", callback_group=ReentrantCallbackGroup())

def twice(request, response):
    future = inner.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    return future.result()

node.create_service(AddTwoInts, "twice", twice)
executor = MultiThreadedExecutor(4)
for each in (node, other):
    executor.add_node(each)
threading.Thread(target=executor.spin, daemon=True).start()
client = Node("m").create_client(AddTwoInts, "twice")
print(client.call(REQUEST).sum)
future = client.call_async(REQUEST)
time.sleep(2)
print(future.done())
"""
    _, out, err = run(HEAD + SOONER + source)
    assert out == "3\nFalse\n"
    [line] = [each for each in told(err) if "/twice: " in each]
    assert "/twice: twice() (service /twice) of /n spun /n with a function of rclpy" in line


def test_a_future_of_an_unspun_node_is_reported_at_the_end(run):
    source = "print(node.create_client(AddTwoInts, 'add').call_async(REQUEST).result())"
    _, out, err = run(HEAD + source)
    assert out == "None\n"
    assert ["no thread spins /n" in line for line in told(err)] == [True]


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


def test_an_unobserved_call_is_not_reported(run):
    offer = 'node.create_service(AddTwoInts, "add", add)\n'
    call = "node.create_client(AddTwoInts, 'add').call_async(REQUEST)\nprint('sent')"
    assert run(HEAD + offer + call) == (0, "sent\n", "")


def test_a_wait_for_a_coroutine_that_awaits_something_else_is_no_deadlock(run):
    source = """
def slept(seconds):
    future = rclpy.Future()
    node.create_timer(seconds, lambda: future.set_result(None), ReentrantCallbackGroup())
    return future


async def slow(request, response):
    await slept(1)
    return add(request, response)


node.create_service(AddTwoInts, "slow", slow)
client = node.create_client(AddTwoInts, "slow", callback_group=ReentrantCallbackGroup())
futures = [client.call_async(REQUEST) for _ in range(2)]
for future in futures:
    rclpy.spin_until_future_complete(node, future)
    print(future.result().sum)
"""
    assert run(HEAD + SOONER + source) == (0, "3\n3\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="no process gets just a Ctrl-C there")
def test_a_program_that_ctrl_c_ended_before_it_could_spin_is_not_blamed(ros):
    source = "future = node.create_client(AddTwoInts, 'add').call_async(REQUEST)\nprint('up')\n"
    program = ros(HEAD + source + "time.sleep(30)\nrclpy.spin(node)")
    program.wait_for("up")
    assert (program.interrupt(), program.err) == (INTERRUPTED, "KeyboardInterrupt\n")


def test_a_response_that_a_waiting_coroutine_blocks_is_reported(run):
    source = RELAY.format(wait="answer = await inner.call_async(request)", group="")
    source = SOONER + source.replace("def twice", "async def twice")
    _, _, err = run(HEAD + source + "ask('twice', 2.5)")
    assert ["twice() holds while it awaits" in line for line in told(err)] == [True]


def test_a_callback_that_does_not_return_is_reported_with_its_line(run):
    source = """
def slow():
    time.sleep(1.5)  # here
    rclpy.shutdown()
node.create_timer(0.01, slow)
{other}
rclpy.spin(node)
"""
    assert told(run(HEAD + SOONER + source.format(other=""))[2]) == []  # it keeps nobody
    other = "node.create_timer(0.1, lambda: None)"
    _, _, err = run(HEAD + SOONER + source.format(other=other))
    [line] = told(err)
    assert "slow() of /n has not returned for 0.8 s (program.py:" in line
    assert "time.sleep(1.5)  # here" in line


ALL_WAIT = """
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup as Group
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
inner = node.create_client(AddTwoInts, "inner", callback_group=Group())
node.create_service(AddTwoInts, "inner", add, callback_group=Group())
node.create_service(
    AddTwoInts, "outer", lambda request, response: inner.call(request), callback_group=Group())
outer = node.create_client(AddTwoInts, "outer", callback_group=Group())
def tick():
    timer.cancel()
    print(outer.call(REQUEST).sum)
    rclpy.shutdown()
timer = node.create_timer(0.01, tick, callback_group=Group())
executor = MultiThreadedExecutor(num_threads={threads})
executor.add_node(node)
import threading
threading.Timer(2, rclpy.try_shutdown).start()
try:
    executor.spin()
except ExternalShutdownException:
    pass
"""


def test_a_pool_whose_threads_all_wait_for_responses_is_reported(run):
    soon = SOONER + "from rclpy import client as module\nmodule._LONG_GRACE = 0.5\n"
    status, out, err = run(HEAD + soon + ALL_WAIT.format(threads=2))
    [line] = told(err)
    assert "all 2 threads of the MultiThreadedExecutor wait in Client.call" in line
    assert "tick() of /n for /outer" in line
    assert (status, out) == (0, "")
    assert run(HEAD + soon + ALL_WAIT.format(threads=3)) == (0, "3\n", "")


LONG = """
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup as Group
from rclpy.executors import MultiThreadedExecutor
def mission():
    timer.cancel()
    rate = node.create_rate(20)
    for _ in range(30):
        rate.sleep()
    print("done")
    rclpy.shutdown()
timer = node.create_timer(0.01, mission, callback_group=Group())
node.create_timer(0.1, lambda: None)
executor = MultiThreadedExecutor(num_threads=3)
executor.add_node(node)
executor.spin()
"""


def test_a_long_callback_that_blocks_no_other_is_not_reported(run):
    assert run(HEAD + SOONER + LONG) == (0, "done\n", "")


NOW_AND_THEN = """
node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")
rclpy.spin_once(node, timeout_sec=0)
for _ in range(2):
    future = client.call_async(REQUEST)
    time.sleep(dog._LATE + 0.2)  # somebody types
    rclpy.spin_until_future_complete(node, future)
    print(future.result().sum)
"""


def test_a_node_that_is_spun_rarely_is_not_reported(run):
    patient = SOONER + "dog._STUCK = 60\n"  # a busy machine may sleep much longer
    assert run(HEAD + patient + NOW_AND_THEN) == (0, "3\n3\n", "")


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
        first.kill()


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
