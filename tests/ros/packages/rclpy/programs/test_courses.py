"""Programs from courses and of students print the same as on ROS 2."""

import sys

import pytest

from tests.ros.packages.rclpy.programs.running import INTERRUPTED

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

HEAD = """
import sys
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int64
from std_srvs.srv import SetBool, Trigger


class Adder(Node):
    def __init__(self, name="adder"):
        super().__init__(name)
        self.create_service(AddTwoInts, "add", self.add)

    def add(self, request, response):
        response.sum = request.a + request.b
        return response
"""

PROGRAMS = {
    "a robot whose timer callback spins its executor until a response arrives": (
        """
class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.client = self.create_client(
            AddTwoInts, "add", callback_group=MutuallyExclusiveCallbackGroup()
        )
        self.create_timer(0.05, self.loop, callback_group=MutuallyExclusiveCallbackGroup())

    def loop(self):
        future = self.client.call_async(AddTwoInts.Request(a=40, b=2))
        self.executor.spin_until_future_complete(future)
        print(future.result().sum)
        raise KeyboardInterrupt

    def destroy_node(self):
        print("stopping")
        super().destroy_node()


rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
robot, adder, executor = Robot(), Adder(), SingleThreadedExecutor()
executor.add_node(robot)
executor.add_node(adder)
try:
    executor.spin()
except KeyboardInterrupt:
    pass
finally:
    robot.destroy_node()
    rclpy.try_shutdown()
""",
        "42\nstopping\n",
    ),
    "a server that spins its node until a message arrives": (
        """
class Waiter(Node):
    def __init__(self):
        super().__init__("waiter")
        self.number = None
        group = ReentrantCallbackGroup()
        self.create_subscription(Int64, "number", self.heard, 10, callback_group=group)
        self.create_service(Trigger, "wait", self.wait, callback_group=group)

    def heard(self, message):
        self.number = message.data

    def wait(self, request, response):
        while self.number is None:
            rclpy.spin_once(self, timeout_sec=0.01)
        response.success, response.message = True, f"heard {self.number}"
        return response


rclpy.init()
waiter, asker = Waiter(), Node("asker")
publisher = asker.create_publisher(Int64, "number", 10)
asker.create_timer(0.05, lambda: publisher.publish(Int64(data=7)))
pool = MultiThreadedExecutor(4)
pool.add_node(waiter)
pool.add_node(asker)
future = asker.create_client(Trigger, "wait").call_async(Trigger.Request())
pool.spin_until_future_complete(future)
print(future.result().message)
pool.shutdown()
rclpy.shutdown()
""",
        "heard 7\n",
    ),
    "coroutines that sleep by timers, in a task": (
        """
async def sleep(node, seconds):
    future = rclpy.Future()
    timer = node.create_timer(seconds, lambda: future.set_result(None))
    await future
    node.destroy_timer(timer)


class Sleeper(Node):
    def __init__(self):
        super().__init__("sleeper")
        self._default_callback_group = ReentrantCallbackGroup()
        self.create_service(AddTwoInts, "slow", self.slow)
        self.client = self.create_client(AddTwoInts, "slow")

    async def slow(self, request, response):
        print("begin", request.a)
        await sleep(self, request.a / 10)
        print("end", request.a)
        response.sum = request.a
        return response

    async def ask(self):
        futures = [self.client.call_async(AddTwoInts.Request(a=a)) for a in (3, 1)]
        return [(await future).sum for future in futures]


rclpy.init()
node, executor = Sleeper(), SingleThreadedExecutor()
executor.add_node(node)
task = executor.create_task(node.ask())
executor.spin_until_future_complete(task)
print(task.result())
""",
        "begin 3\nbegin 1\nend 1\nend 3\n[3, 1]\n",
    ),
    "a menu that calls services and does not wait for the responses": (
        """
rclpy.init()
node = rclpy.create_node("menu")
clients = [node.create_client(Trigger, name) for name in ("clear", "reset")]
for choice in sys.argv[1:]:
    clients[int(choice)].call_async(Trigger.Request())
    print("sent")
rclpy.shutdown()
""",
        "sent\nsent\n",
    ),
    "a call that a timer cancels": (
        """
class Impatient(Node):
    def __init__(self):
        super().__init__("impatient")
        self.client = self.create_client(Trigger, "never")
        self.future = None
        self.create_timer(0.1, self.tick)

    def tick(self):
        if self.future is not None and not self.future.done():
            self.future.cancel()
            print("given up", self.future.cancelled())
            raise SystemExit
        self.future = self.client.call_async(Trigger.Request())
        self.future.add_done_callback(lambda future: print("result", future.result()))


rclpy.init()
node = Impatient()
async def never(request, response):
    await rclpy.Future()
node.create_service(Trigger, "never", never, callback_group=ReentrantCallbackGroup())
try:
    rclpy.spin(node)
except SystemExit:
    rclpy.spin_once(node, timeout_sec=0)
""",
        "result None\ngiven up True\n",
    ),
    "a node in a second context, beside the default context": (
        """
import threading
rclpy.init()
context = rclpy.Context()
rclpy.init(context=context)
node = Node("inner", context=context)
executor = MultiThreadedExecutor(2, context=context)
executor.add_node(node)
thread = threading.Thread(target=executor.spin)
thread.start()
node.create_service(SetBool, "~/set", lambda request, response: response)
client = node.create_client(SetBool, "inner/set", callback_group=ReentrantCallbackGroup())
print(client.wait_for_service(timeout_sec=5), client.call(SetBool.Request(data=True)))
rclpy.shutdown(context=context)
thread.join()
print(context.ok(), rclpy.ok())
""",
        "True std_srvs.srv.SetBool_Response(success=False, message='')\nFalse True\n",
    ),
    "a manager that changes the state of a lifecycle node through its service": (
        """
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn


class Managed(LifecycleNode):
    def on_configure(self, state):
        print("configure from", state.label)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        print("activate from", state.label)
        return super().on_activate(state)


rclpy.init()
managed, manager, executor = Managed("managed"), Node("manager"), SingleThreadedExecutor()
executor.add_node(managed)
executor.add_node(manager)
client = manager.create_client(ChangeState, "/managed/change_state")
for number in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
    request = ChangeState.Request()
    request.transition.id = number
    future = client.call_async(request)
    executor.spin_until_future_complete(future)
    print(future.result().success)
""",
        "configure from unconfigured\nTrue\nactivate from inactive\nTrue\n",
    ),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_course_program_prints_the_same_as_on_ros(run, name):
    source, out = PROGRAMS[name]
    assert run(HEAD + source, 0, 1) == (0, out, "")


PANEL = """
import rclpy
from rclpy.node import Node
from panel_interfaces.msg import Leds
from panel_interfaces.srv import SetLed


class Panel(Node):
    def __init__(self):
        super().__init__("panel")
        self.declare_parameter("leds", [0, 0, 0])
        self.leds = self.get_parameter("leds").value
        self.has_heard = False
        self.publisher = self.create_publisher(Leds, "leds", 10)
        self.create_subscription(Leds, "leds", self.heard, 10)
        self.create_service(SetLed, "set_led", self.set_led)

    def heard(self, message):
        print(message.leds, list(message.leds), message)
        self.has_heard = True

    def set_led(self, request, response):
        print(request)
        self.leds[request.number] = request.state
        self.publisher.publish(Leds(leds=self.leds))
        self.get_logger().info(f"leds: {self.leds}")
        response.panel.leds = self.leds
        return response


rclpy.init()
panel = Panel()
client = panel.create_client(SetLed, "set_led")
future = client.call_async(SetLed.Request(number=1, state=1))
rclpy.spin_until_future_complete(panel, future)
print(future.result())
while not panel.has_heard:
    rclpy.spin_once(panel)
"""


def test_program_with_own_interfaces_uses_them_in_messages_services_and_parameters(run, tmp_path):
    for file, text in {
        "msg/Leds.msg": "int64[] leds\n",
        "srv/SetLed.srv": "int64 number\nint64 state\n---\nLeds panel\n",
    }.items():
        path = tmp_path / "panel_interfaces" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    leds = "panel_interfaces.msg.Leds(leds=[0, 1, 0])"
    code, out, err = run(PANEL)
    assert (code, err) == (0, "[INFO] [T] [panel]: leds: [0, 1, 0]\n")
    assert sorted(out.splitlines()) == [
        f"array('q', [0, 1, 0]) [0, 1, 0] {leds}",
        "panel_interfaces.srv.SetLed_Request(number=1, state=1)",
        f"panel_interfaces.srv.SetLed_Response(panel={leds})",
    ]


def test_a_service_beside_an_action_responds(run):
    source = """
from rclpy.action import ActionServer
from example_interfaces.action import Fibonacci


class Both(Adder):
    def __init__(self):
        super().__init__()
        self.actions = ActionServer(self, Fibonacci, "fibonacci", self.execute)

    def execute(self, goal_handle):
        goal_handle.succeed()
        return Fibonacci.Result()


rclpy.init()
node = Both()
future = node.create_client(AddTwoInts, "add").call_async(AddTwoInts.Request(a=1, b=2))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
node.actions.destroy()
"""
    assert run(HEAD + source) == (0, "3\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C reaches the whole console there")
def test_node_that_its_module_spins_at_import_responds(ros, run):
    server = ros(
        HEAD + "rclpy.init()\nnode = Adder()\nprint('ready')\nrclpy.spin(node)\n", name="s.py"
    )
    server.wait_for("ready")
    call = """
with rclpy.init():
    node = Node("caller")
    client = node.create_client(AddTwoInts, "add")
    client.wait_for_service()
    future = client.call_async(AddTwoInts.Request(a=20, b=3))
    while rclpy.ok() and not future.done():
        rclpy.spin_once(node)
    print(future.result())
"""
    out = "example_interfaces.srv.AddTwoInts_Response(sum=23)\n"
    assert run(HEAD + call) == (0, out, "")
    assert server.interrupt() == INTERRUPTED
