"""A callback that waits for its own end is refused; other waits are not."""

import pytest

from tests.ros.packages.rclpy._impl.diagnostics.sources import (
    CALL,
    HEAD,
    OWN,
    POOL,
    RELAY,
    SOONER,
    told,
)

pytestmark = pytest.mark.real_time

SPIN = (
    "future = inner.call_async(request); rclpy.spin_until_future_complete(node, future);"
    " answer = future.result()"
)


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
from rclpy import client as module
module._LONG_GRACE = 0.1  # for so long the end of the executor waits for a call that has failed

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
    executor.spin_until_future_complete(future, 60)
except RuntimeError as error:
    print(type(error).__name__)
executor.shutdown()
"""
    _, out, err = run(HEAD + source)
    assert out == "WouldDeadlock\n"
    [line] = [each for each in told(err) if "in a circle" in each]
    assert "(service /b) of /b -> /a -> Asks.ask() (service /a) of /a -> /b -> Asks.ask()" in line


@pytest.mark.faults
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


@pytest.mark.faults
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
