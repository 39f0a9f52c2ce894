"""An AsyncNode runs callbacks on the event loop, from its entry to its destruction."""

import asyncio
import threading

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.action import ActionClient, ActionServer
from taskrpc.ros.packages.rclpy.context import end_all_by_signal
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.experimental import AsyncNode
from taskrpc.ros.packages.rclpy.node import BaseNode, Node
from tests.ros.packages.rclpy.living import PATIENCE

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")
GetParameters = srvgen.load("rcl_interfaces/srv/GetParameters")


def in_time(coroutine):
    return asyncio.wait_for(coroutine, PATIENCE)


async def nothing(*_):
    return None


async def test_entities_work_that_were_created_before_the_node_runs(create):
    node, received = create(), asyncio.Event()
    publisher = node.create_publisher(String, "chat", 10)
    node.create_subscription(String, "chat", lambda _: received.set(), 10)
    publisher.publish(String(data="early"))
    async with node:
        await in_time(received.wait())


async def test_run_ends_with_destroy_node(create):
    node = create()
    asyncio.get_running_loop().call_later(0.01, node.destroy_node)
    await in_time(node.run())
    assert not node.handle.valid


async def test_a_callback_may_destroy_its_node(create):
    node = create()

    async def callback(_):
        node.destroy_node()

    publisher = node.create_publisher(String, "chat", 10)
    node.create_subscription(String, "chat", callback, 10)
    publisher.publish(String())
    await in_time(node.run())


async def test_a_running_node_cannot_run_again(create):
    async with create() as node:
        with pytest.raises(RuntimeError, match="Node is already running"):
            await node.run()


async def test_a_destroyed_node_cannot_run_again(create):
    node = create()
    async with node:
        pass
    with pytest.raises(RuntimeError, match="cannot be reentered"):
        await node.run()


async def test_a_destroyed_node_creates_nothing(create):
    node = create()
    node.destroy_node()
    node.destroy_node()
    for creation in (
        lambda: node.create_publisher(String, "chat", 1),
        lambda: node.create_subscription(String, "chat", nothing, 1),
        lambda: node.create_client(Trigger, "trigger"),
        lambda: node.create_service(Trigger, "trigger", nothing),
        lambda: node.create_timer(1, nothing),
    ):
        with pytest.raises(RuntimeError, match="on a destroyed node"):
            creation()


async def test_an_exception_in_the_block_destroys_the_node(create):
    node = create()
    with pytest.raises(ExceptionGroup) as raised:
        async with node:
            raise ValueError("mine")
    assert raised.group_contains(ValueError)
    assert not node.handle.valid


async def test_the_shutdown_of_the_context_destroys_a_running_node(create, context):
    node, began = create(), asyncio.Event()

    async def callback():
        began.set()
        await asyncio.Event().wait()

    node.create_timer(0.001, callback)
    async with node:
        await in_time(began.wait())
        context.shutdown()
    assert not node.handle.valid


async def test_another_thread_may_shut_the_context_down(create, context):
    node = create()
    running = asyncio.create_task(node.run())
    await asyncio.sleep(0)
    thread = threading.Thread(target=context.shutdown)
    thread.start()
    await in_time(running)
    thread.join()
    assert not node.handle.valid


async def test_a_signal_that_shuts_the_context_down_ends_run(create):
    node = create()
    running = asyncio.create_task(node.run())
    await asyncio.sleep(0)
    end_all_by_signal()
    await in_time(running)


async def test_its_parameters_are_offered_to_other_nodes(create):
    node, other = create(start_parameter_services=True), create("other")
    node.declare_parameter("speed", 3)
    async with node, other:
        client = other.create_client(GetParameters, "/robot/get_parameters")
        answer = await in_time(client.call(GetParameters.Request(names=["speed"])))
    assert answer.values[0].integer_value == 3


async def test_it_waits_for_another_node(create):
    create("target", namespace="/lab")
    async with create() as node:
        await in_time(node.wait_for_node("lab/target"))
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await node.wait_for_node("nobody")


async def test_an_executor_refuses_it(create, context):
    with pytest.raises(TypeError, match="await node"):
        SingleThreadedExecutor(context=context).add_node(create())


async def test_an_action_server_refuses_it_and_offers_nothing(create, context):
    node = create()
    offered = node.get_service_names_and_types()
    fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
    reason = "has no actions; create action servers and clients on a"
    with pytest.raises(TypeError, match=reason):
        ActionServer(node, fibonacci, "fibonacci", nothing)
    with pytest.raises(TypeError, match=reason):
        ActionClient(node, fibonacci, "fibonacci")
    assert node.get_service_names_and_types() == offered


def test_it_shares_a_base_class_with_node():
    assert issubclass(AsyncNode, BaseNode)
    assert issubclass(Node, BaseNode)
    assert not issubclass(AsyncNode, Node)


SERVER = """
import asyncio

import rclpy
from example_interfaces.srv import AddTwoInts, Trigger
from rclpy.experimental import AsyncNode


class Adder(AsyncNode):
    def __init__(self):
        super().__init__("adder")
        self.client = self.create_client(AddTwoInts, "add_two_ints")
        self.create_service(Trigger, "trigger", self.answer)
        self.create_service(AddTwoInts, "add_two_ints", self.add)

    def add(self, request, response):
        response.sum = request.a + request.b
        return response

    async def answer(self, _, response):
        await self.get_clock().sleep(0.01)
        added = await self.client.call(AddTwoInts.Request(a=2, b=2))
        response.success, response.message = True, f"2+2={added.sum}"
        return response


async def main():
    with rclpy.init():
        await Adder().run()


asyncio.run(main())
"""
CLIENT = """
import asyncio

import rclpy
from example_interfaces.srv import Trigger
from rclpy.experimental import AsyncNode


async def main():
    with rclpy.init():
        async with AsyncNode("asking") as node:
            client = node.create_client(Trigger, "trigger")
            await client.wait_for_service()
            response = await client.call(Trigger.Request())
            print(response.success, response.message)


asyncio.run(main())
"""


def test_a_callback_calls_another_service_of_its_own_node(ros, run):
    server = ros(SERVER, name="server.py")
    assert run(CLIENT) == (0, "True 2+2=4\n", "")
    server.interrupt()
    server.end()
    assert server.err.splitlines()[-1:] == ["KeyboardInterrupt"], server.err
