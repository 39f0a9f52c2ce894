"""Services respond on the spinning thread; their errors are raised there and sent to the caller."""

import gc

import pytest

import srvgen
from taskrpc.errors import HandlerFailed, InvalidRequest
from taskrpc.ros.packages.rclpy.callback_groups import ReentrantCallbackGroup
from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.node import Node
from taskrpc.ros.packages.rclpy.task import Future
from tests.ros.packages.rclpy.living import PATIENCE, context_of, service_of

pytestmark = pytest.mark.real_time

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Request = AddTwoInts.Request


def called(world, callback, **settings):
    """Return the future of a call of a service with this callback."""
    world.node("server").create_service(AddTwoInts, "add", callback, **settings)
    client = world.node("caller").create_client(AddTwoInts, "add")
    return client.call_async(Request(a=1, b=2))


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (None, "returned nothing; is `return response`"),
        (3, "returned a value of the type int, expected AddTwoInts_Response"),
        (AddTwoInts.Response, "returned the class AddTwoInts_Response, expected AddTwoInts"),
        (Request(), "returned a value of the type AddTwoInts_Request, expected AddTwoInts"),
    ],
)
def test_wrong_response_type_raises_for_server_and_caller(world, answer, text):
    future = called(world, lambda request, response: answer)
    with pytest.raises(TypeError, match=text):
        world.answer(future)
    world.executor.spin_until_future_complete(future, PATIENCE)
    with pytest.raises(HandlerFailed, match=text):
        future.result()


def test_value_out_of_range_is_named_to_server_and_caller(world):
    def overflow(request, response):
        response.sum = 2**70
        return response

    future = called(world, overflow)
    with pytest.raises(InvalidRequest, match="sum: expected int64"):
        world.answer(future)
    world.executor.spin_until_future_complete(future, PATIENCE)
    with pytest.raises(HandlerFailed, match="the response of /add: sum: expected int64"):
        future.result()


@pytest.mark.parametrize("what", ["service", "node"])
def test_a_callback_that_destroys_its_service_is_an_error_on_both_sides(world, what):
    def leave(request, response):
        node = next(each for each in world.executor.get_nodes() if each.get_name() == "server")
        if what == "node":
            node.destroy_node()
        else:
            node.destroy_service(service_of(node, "/add"))
        return response

    future = called(world, leave)
    with pytest.raises(InvalidHandle):
        world.answer(future)
    world.executor.spin_until_future_complete(future, PATIENCE)
    with pytest.raises(HandlerFailed, match="destroyed its service before it returned"):
        future.result()


@pytest.mark.parametrize("is_async", [False, True])
def test_response_is_sent_although_the_callback_shuts_down(world, is_async):
    """The caller is in another context, as in another program."""

    def leave(request, response):
        server.context.shutdown()
        response.sum = 3
        return response

    async def leave_async(request, response):
        return leave(request, response)

    with context_of() as context:
        server = Node("server", context=context)
        server.create_service(AddTwoInts, "add", leave_async if is_async else leave)
        future = world.node("caller").create_client(AddTwoInts, "add").call_async(Request())
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(server)
        executor.spin()
        assert world.answer(future).sum == 3


def test_an_async_callback_may_await_another_service(world):
    async def ask(request, response):
        inner = await further.call_async(request)
        response.sum = 2 * inner.sum
        return response

    def add(request, response):
        response.sum = request.a + request.b
        return response

    node = world.node("further")
    node.create_service(AddTwoInts, "further", add)
    further = world.node("asking").create_client(AddTwoInts, "further")
    future = called(world, ask, callback_group=ReentrantCallbackGroup())
    assert world.answer(future).sum == 6


def test_exception_of_an_async_callback_leaves_spin_and_is_sent_to_the_caller(world):
    async def fail(request, response):
        raise ValueError("boom")

    future = called(world, fail)
    with pytest.raises(ValueError, match="boom"):
        world.answer(future)
    world.executor.spin_until_future_complete(future, PATIENCE)
    with pytest.raises(HandlerFailed, match="boom"):
        future.result()


def test_second_service_of_the_program_takes_over_when_the_first_is_destroyed(world):
    def says(number):
        def answer(request, response):
            response.sum = number
            return response

        return answer

    first, second = world.node("first"), world.node("second")
    service = first.create_service(AddTwoInts, "add", says(1))
    second.create_service(AddTwoInts, "add", says(2))
    client = world.node("caller").create_client(AddTwoInts, "add")
    assert world.answer(client.call_async(Request())).sum == 1
    assert first.destroy_service(service)
    assert world.answer(client.call_async(Request())).sum == 2


def test_requests_can_be_taken_without_a_callback(world):
    server = world.node("server")
    service = server.create_service(AddTwoInts, "add", None)
    assert service.handle.service_take_request(Request) == (None, None)
    world.executor.remove_node(server)
    client = world.node("caller").create_client(AddTwoInts, "add")
    future = client.call_async(Request(a=4))
    world.spin_until(service.has_work)
    request, header = service.handle.service_take_request(Request)
    assert (request.a, header.source_timestamp > 0) == (4, True)
    service.send_response(AddTwoInts.Response(sum=9), header)
    assert world.answer(future).sum == 9


def test_end_of_a_with_block_destroys_the_service(world):
    node = world.node()
    with node.create_service(AddTwoInts, "add", None) as service:
        assert node.count_services("add") == 1
    assert service not in node.services
    assert node.count_services("add") == 0


def test_request_runs_even_if_its_caller_has_cancelled_it(world):
    def add(request, response):
        done.append(request)
        return response

    done = []
    future = called(world, add)
    server = next(node for node in world.executor.get_nodes() if node.get_name() == "server")
    world.executor.remove_node(server)
    world.spin_until(service_of(server, "/add").has_work)
    future.cancel()
    world.executor.add_node(server)
    world.spin_until(lambda: done)
    assert not future.done()


def test_coroutine_whose_future_nobody_else_has_is_not_garbage(world, capsys):
    async def wait_for_ever(request, response):
        await Future()
        return response

    future = called(world, wait_for_ever, callback_group=ReentrantCallbackGroup())
    for _ in range(5):
        world.executor.spin_once(timeout_sec=0.05)
        gc.collect()
    assert not future.done()
    assert capsys.readouterr().err == ""
