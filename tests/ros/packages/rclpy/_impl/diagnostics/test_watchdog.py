"""Work that waits for ever is reported, and work that is only slow is not."""

import sys

import pytest

from tests.ros.packages.rclpy._impl.diagnostics.sources import HEAD, RELAY, SOONER, told
from tests.ros.packages.rclpy.programs.running import INTERRUPTED

pytestmark = pytest.mark.real_time


@pytest.mark.faults
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


@pytest.mark.faults
def test_a_program_that_spins_rarely_is_not_reported(run):
    source = """
dog._LATE = dog._STUCK = 60  # a busy machine may sleep much longer
node.create_service(AddTwoInts, "add", add)
future = node.create_client(AddTwoInts, "add").call_async(REQUEST)
while not future.done():
    time.sleep(dog._SOON + 0.5)
    rclpy.spin_once(node, timeout_sec=0.01)
print(future.result().sum)
"""
    assert run(HEAD + SOONER + source) == (0, "3\n", "")


def test_an_unspun_call_is_completed_and_reported(run):
    source = """
node.create_service(AddTwoInts, "add", add)
threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
print(Node("m").create_client(AddTwoInts, "add").call(REQUEST).sum)
"""
    code, out, err = run(HEAD + source)
    assert (code, out) == (0, "3\n")
    assert ["no other thread spins /m" in line for line in told(err)] == [True]


@pytest.mark.faults
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


def test_an_unobserved_call_is_not_reported(run):
    offer = 'node.create_service(AddTwoInts, "add", add)\n'
    call = "node.create_client(AddTwoInts, 'add').call_async(REQUEST)\nprint('sent')"
    call += "\nrclpy.spin_once(node, timeout_sec=0.0)"
    assert run(HEAD + offer + call) == (0, "sent\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="no process gets just a Ctrl-C there")
def test_a_program_that_ctrl_c_ended_before_it_could_spin_is_not_blamed(ros):
    source = "future = node.create_client(AddTwoInts, 'add').call_async(REQUEST)\nprint('up')\n"
    program = ros(HEAD + source + "time.sleep(30)\nrclpy.spin(node)")
    program.wait_for("up")
    assert (program.interrupt(), program.err) == (INTERRUPTED, "KeyboardInterrupt\n")


@pytest.mark.faults
def test_a_response_that_a_waiting_coroutine_blocks_is_reported(run):
    source = RELAY.format(wait="answer = await inner.call_async(request)", group="")
    source = SOONER + source.replace("def twice", "async def twice")
    _, _, err = run(HEAD + source + "ask('twice', 2.5)")
    assert ["twice() holds while it awaits" in line for line in told(err)] == [True]


@pytest.mark.faults
def test_a_callback_that_does_not_return_is_reported_with_its_line(run):
    source = """
def slow():
    time.sleep(1.5)  # here
    rclpy.shutdown()
node.create_timer(0.01, slow)
{other}
rclpy.spin(node)
"""
    assert told(run(HEAD + SOONER + source.format(other=""))[2]) == []  # it delays no callback
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
late = threading.Timer(2, rclpy.try_shutdown)
late.daemon = True
late.start()
try:
    executor.spin()
except ExternalShutdownException:
    pass
"""


@pytest.mark.faults
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


@pytest.mark.faults
def test_a_long_callback_that_blocks_no_other_is_not_reported(run):
    assert run(HEAD + SOONER + LONG) == (0, "done\n", "")


NOW_AND_THEN = """
node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")
rclpy.spin_once(node, timeout_sec=0)
for _ in range(2):
    future = client.call_async(REQUEST)
    time.sleep(dog._LATE + 0.2)  # as while the user types
    rclpy.spin_until_future_complete(node, future)
    print(future.result().sum)
"""


@pytest.mark.faults
def test_a_node_that_is_spun_rarely_is_not_reported(run):
    patient = SOONER + "dog._STUCK = 60\n"  # a busy machine may sleep much longer
    assert run(HEAD + patient + NOW_AND_THEN) == (0, "3\n3\n", "")


UNSPUN = {
    "service": 'node.create_service(AddTwoInts, "add", add)',
    "timer": "node.create_timer(1.0, print)",
    "subscription": 'node.create_subscription(String, "chatter", print, 10)',
    "action": 'ActionServer(node, Fibonacci, "fib", print)',
}
MORE = """
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer
from std_msgs.msg import String
"""


@pytest.mark.end_to_end
@pytest.mark.parametrize("what", UNSPUN)
@pytest.mark.parametrize("end", ["", "rclpy.shutdown()"])
def test_a_node_that_ends_before_a_thread_spun_it_is_reported_in_one_line(run, what, end):
    code, out, err = run(HEAD + MORE + UNSPUN[what] + "\n" + end)
    offered = {"service": ", which offers /add,", "action": ", which offers /fib/_action/send_goal"}
    assert (code, out, err.count("\n")) == (0, "", 1)
    assert err.startswith(f"[taskrpc] the node n{offered.get(what, ' ends before a')}")
    assert err.endswith(" ends before a callback of it could run; call rclpy.spin(node)\n")


@pytest.mark.end_to_end
@pytest.mark.parametrize(
    "source",
    [
        'node.create_publisher(String, "chatter", 10).publish(String())',
        'node.create_client(AddTwoInts, "absent")',
        'Node("adder").create_service(AddTwoInts, "add", add); sys.exit("wrong")',
        f"{UNSPUN['timer']}; rclpy.spin_once(node, timeout_sec=0.0)",
        f"{UNSPUN['service']}; ask('absent', 0.01)",
        f"{UNSPUN['service']}; raise SystemExit(3)",
        f"{UNSPUN['service']}; 1 / 0",
        f"try:\n    {UNSPUN['service']}; 1 / 0\nfinally:\n    rclpy.shutdown()",
        f"{UNSPUN['service']}; node.destroy_node(); raise KeyboardInterrupt",
    ],
)
def test_a_node_without_callbacks_of_its_own_or_with_another_reason_to_end_is_silent(run, source):
    _, _, err = run(HEAD + MORE + source)
    assert "before a callback" not in err


def test_an_unspun_node_is_not_reported_with_like_ros(run, monkeypatch):
    monkeypatch.setenv("TASKRPC_LIKE_ROS", "1")
    assert run(HEAD + UNSPUN["service"]) == (0, "", "")
