"""ROS 2 programs of all common styles run unchanged."""

import os

import pytest

from tests.ros.packages.rclpy.programs.running import INTERRUPTED, domain_in, programs_in

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

SERVER = """
import rclpy
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts


class Adder(Node):
    def __init__(self):
        super().__init__("adder")
        self.create_service(AddTwoInts, "add", self.add)
        self.get_logger().info("ready")

    def add(self, request, response):
        response.sum = request.a + request.b
        return response


rclpy.init()
rclpy.spin(Adder())
"""


@pytest.fixture(scope="module")
def beside_an_adder(tmp_path_factory):
    """The environment variables of programs that see the server `adder`, which all tests share."""
    folder = tmp_path_factory.mktemp("adder")
    users = {name: value for name, value in os.environ.items() if not name.startswith("TASKRPC_")}
    variables = domain_in(folder)
    with programs_in(folder, users | variables) as start:
        start(SERVER, name="adder.py").wait_for("ready")
        yield variables


@pytest.fixture
def adder(ros, beside_an_adder, monkeypatch):
    for name, value in beside_an_adder.items():
        monkeypatch.setenv(name, value)


HEAD = """
import rclpy
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts
Request = AddTwoInts.Request
"""

CLIENTS = {
    "a node without a class, and spin_until_future_complete": """
rclpy.init()
node = rclpy.create_node("caller")
client = node.create_client(AddTwoInts, "add")
while not client.wait_for_service(timeout_sec=1.0):
    node.get_logger().info("waiting")
future = client.call_async(Request(a=1, b=2))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
node.destroy_node()
rclpy.shutdown()
""",
    "init as a context manager": """
with rclpy.init():
    node = Node("caller")
    client = node.create_client(AddTwoInts, "add")
    client.wait_for_service()
    future = client.call_async(Request(a=1, b=2))
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    print(future.result().sum)
""",
    "a loop of spin_once until the future is done": """
rclpy.init(args=None)
node = Node("caller")
client = node.create_client(srv_type=AddTwoInts, srv_name="add")
client.wait_for_service(5.0)
request = Request()
request.a, request.b = 1, 2
future = client.call_async(request)
while rclpy.ok():
    rclpy.spin_once(node)
    if future.done():
        try:
            response = future.result()
        except Exception as error:
            node.get_logger().error(f"failed: {error!r}")
        else:
            print(response.sum)
        break
node.destroy_node()
rclpy.shutdown()
""",
    "a done callback that ends the spinning": """
class Caller(Node):
    def __init__(self):
        super().__init__("caller")
        self.client = self.create_client(AddTwoInts, "add")
        self.client.wait_for_service()
        self.client.call_async(Request(a=1, b=2)).add_done_callback(self.done)

    def done(self, future):
        print(future.result().sum)
        raise SystemExit


rclpy.init()
try:
    rclpy.spin(Caller())
except SystemExit:
    rclpy.shutdown()
""",
    "a call that blocks, while a thread spins": """
import threading
rclpy.init()
node = Node("caller")
thread = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
thread.start()
client = node.create_client(AddTwoInts, "add")
client.wait_for_service()
print(client.call(Request(a=1, b=2)).sum)
rclpy.shutdown()
thread.join()
""",
    "a timer that calls, and a future that ends the spinning": """
class Caller(Node):
    def __init__(self):
        super().__init__("caller")
        self.client = self.create_client(AddTwoInts, "add")
        self.timer = self.create_timer(0.05, self.tick)
        self.finished = rclpy.Future()

    def tick(self):
        if not self.client.service_is_ready():
            return
        self.timer.cancel()
        self.client.call_async(Request(a=1, b=2)).add_done_callback(
            lambda future: self.finished.set_result(future.result().sum)
        )


rclpy.init()
node = Caller()
rclpy.spin_until_future_complete(node, node.finished)
print(node.finished.result())
rclpy.shutdown()
""",
    "an executor of its own": """
from rclpy.executors import SingleThreadedExecutor
rclpy.init()
node = Node("caller")
executor = SingleThreadedExecutor()
executor.add_node(node)
client = node.create_client(AddTwoInts, "add")
client.wait_for_service()
future = client.call_async(Request(a=1, b=2))
executor.spin_until_future_complete(future)
print(future.result().sum)
executor.shutdown()
node.destroy_node()
rclpy.shutdown()
""",
    "a call that blocks in a timer, in a group of its own": """
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
node = Node("caller")
client = node.create_client(AddTwoInts, "add", callback_group=MutuallyExclusiveCallbackGroup())
executor = MultiThreadedExecutor()
executor.add_node(node)
finished = rclpy.Future(executor=executor)


def tick():
    timer.cancel()
    client.wait_for_service()
    finished.set_result(client.call(Request(a=1, b=2)).sum)


timer = node.create_timer(0.01, tick, callback_group=MutuallyExclusiveCallbackGroup())
executor.spin_until_future_complete(finished)
print(finished.result())
rclpy.shutdown()
""",
    "an async timer callback that awaits": """
from rclpy.callback_groups import ReentrantCallbackGroup
rclpy.init()
node = Node("caller")
group = ReentrantCallbackGroup()
client = node.create_client(AddTwoInts, "add", callback_group=group)
client.wait_for_service()
finished = rclpy.Future()


async def tick():
    timer.cancel()
    response = await client.call_async(Request(a=1, b=2))
    finished.set_result(response.sum)


timer = node.create_timer(0.01, tick, callback_group=group)
rclpy.spin_until_future_complete(node, finished)
print(finished.result())
rclpy.shutdown()
""",
    "several calls at once, collected in order": """
rclpy.init()
node = Node("caller")
client = node.create_client(AddTwoInts, "add")
client.wait_for_service()
futures = [client.call_async(Request(a=n, b=0)) for n in range(8)]
for future in futures:
    rclpy.spin_until_future_complete(node, future)
assert [future.result().sum for future in futures] == list(range(8))
print(3)
rclpy.shutdown()
""",
    "a remapped name, from the command line": """
rclpy.init(args=["--ros-args", "-r", "sum_service:=add", "-r", "__node:=other"])
node = Node("caller")
assert node.get_name() == "other", node.get_name()
client = node.create_client(AddTwoInts, "sum_service")
client.wait_for_service()
future = client.call_async(Request(a=1, b=2))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
rclpy.shutdown()
""",
    "parameters with the numbers to add": """
rclpy.init(args=["--ros-args", "-p", "a:=1"])
node = Node("caller")
node.declare_parameter("a", 7)
node.declare_parameters("", [("b", 2), ("name", "add")])
values = node.get_parameter("a").value, node.get_parameter("b").get_parameter_value().integer_value
client = node.create_client(AddTwoInts, node.get_parameter("name").value)
client.wait_for_service()
future = client.call_async(Request(a=values[0], b=values[1]))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
rclpy.shutdown()
""",
    "a main function with try and finally": """
from rclpy.executors import ExternalShutdownException


def main(args=None):
    try:
        with rclpy.init(args=args):
            node = Node("caller")
            client = node.create_client(AddTwoInts, "add")
            if not client.wait_for_service(timeout_sec=5.0):
                raise RuntimeError("no server")
            future = client.call_async(Request(a=1, b=2))
            future.add_done_callback(lambda done: (print(done.result().sum), rclpy.shutdown()))
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


main()
""",
    "a topic with the sum": """
from std_msgs.msg import Int64
rclpy.init()
node = Node("caller")
finished = rclpy.Future()
publisher = node.create_publisher(Int64, "sums", 10)
subscription = node.create_subscription(Int64, "sums", lambda m: finished.set_result(m.data), 10)
client = node.create_client(AddTwoInts, "add")
client.wait_for_service()
future = client.call_async(Request(a=1, b=2))
rclpy.spin_until_future_complete(node, future)
while not finished.done():
    publisher.publish(Int64(data=future.result().sum))
    rclpy.spin_once(node, timeout_sec=0.1)
print(finished.result())
rclpy.shutdown()
""",
    "a rate, while a thread spins": """
import threading
rclpy.init()
node = Node("caller")
threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
client = node.create_client(AddTwoInts, "add")
rate = node.create_rate(20)
while not client.service_is_ready():
    rate.sleep()
future = client.call_async(Request(a=1, b=2))
while not future.done():
    rate.sleep()
print(future.result().sum)
rclpy.shutdown()
""",
    "no destroy and no shutdown at all": """
rclpy.init()
node = Node("caller")
client = node.create_client(AddTwoInts, "add")
client.wait_for_service()
future = client.call_async(Request(a=1, b=2))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
""",
}


@pytest.mark.usefixtures("adder")
@pytest.mark.parametrize("style", CLIENTS)
def test_a_client_in_each_style_gets_its_sum(run, style):
    assert run(HEAD + CLIENTS[style]) == (0, "3\n", "")


SERVERS = {
    "spin in try, KeyboardInterrupt and finally": (
        """
node = Adder()
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    print("bye")
finally:
    node.destroy_node()
    rclpy.shutdown()
""",
        (0, "bye\n"),
    ),
    "ExternalShutdownException and KeyboardInterrupt": (
        """
from rclpy.executors import ExternalShutdownException
try:
    rclpy.spin(Adder())
except (KeyboardInterrupt, ExternalShutdownException):
    print("bye")
""",
        (0, "bye\n"),
    ),
    "a loop of spin_once": (
        """
node = Adder()
try:
    while rclpy.ok():
        rclpy.spin_once(node, timeout_sec=0.1)
except KeyboardInterrupt:
    print("bye")
rclpy.try_shutdown()
""",
        (0, "bye\n"),
    ),
    "a MultiThreadedExecutor": (
        """
from rclpy.executors import MultiThreadedExecutor
executor = MultiThreadedExecutor(num_threads=3)
executor.add_node(Adder())
try:
    executor.spin()
except KeyboardInterrupt:
    print("bye")
""",
        (0, "bye\n"),
    ),
    "nothing is caught": ("rclpy.spin(Adder())\n", (INTERRUPTED, "")),
}

ADDER = """
import sys
import rclpy
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts


class Adder(Node):
    def __init__(self):
        super().__init__("adder")
        self.service = self.create_service(AddTwoInts, "add", self.add)
        self.get_logger().info("ready")

    def add(self, request, response):
        self.get_logger().warn(f"adding {request.a} and {request.b}")
        response.sum = request.a + request.b
        return response


rclpy.init(args=sys.argv)
"""

CALL = HEAD + CLIENTS["init as a context manager"]


@pytest.mark.parametrize("style", SERVERS)
def test_a_server_in_each_style_answers_and_ends_with_ctrl_c(ros, run, style):
    source, (status, said) = SERVERS[style]
    server = ros(ADDER + source, name="server.py")
    server.wait_for("ready")
    assert run(CALL) == (0, "3\n", "")
    server.wait_for("adding")
    assert server.interrupt() == status
    assert server.out == said
    assert server.err.splitlines()[:2] == [
        "[INFO] [T] [adder]: ready",
        "[WARN] [T] [adder]: adding 1 and 2",
    ]
    assert "Traceback" not in server.err


@pytest.mark.usefixtures("adder")
def test_second_start_of_a_server_ends_with_a_line_that_names_the_first(run):
    code, out, err = run(SERVER, name="again.py")
    assert (code, out) == (1, "")
    assert len(err.splitlines()) <= 12
    last = err.splitlines()[-1]
    assert "NameInUse: /add is already offered by adder.py (pid " in last
    assert last.endswith("; end it with `taskrpc stop " + last.rpartition(" ")[2])
    assert "join" not in last
