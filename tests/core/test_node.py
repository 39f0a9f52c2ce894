"""A node: its name, start, end, spinning, and its services and clients."""

import asyncio
import gc
import signal
import weakref

import pytest

import taskrpc
from taskrpc.program import fast_loop
from tests.core.transport.helpers import Add, Gate, add, ask, outcome, until


def memory(name="node", **options):
    return taskrpc.Node(name, transport="memory", **options)


def test_names_follow_ros():
    node = memory("arm", namespace="robot1")
    assert node.get_name() == "arm"
    assert node.get_namespace() == "/robot1"
    assert node.get_fully_qualified_name() == "/robot1/arm"
    assert node.resolve_service_name("add") == "/robot1/add"
    assert node.resolve_service_name("~/add") == "/robot1/arm/add"
    assert node.resolve_service_name("/add") == "/add"
    with pytest.raises(taskrpc.InvalidName) as caught:
        memory("my node")
    assert caught.value.index == 2


async def test_services_and_clients_of_a_namespace_find_each_other():
    async with memory("server", namespace="/robot1") as server, memory() as node:
        server.create_service(Add, "add", add)
        server.create_service(Add, "~/own", add)
        for name in ("/robot1/add", "/robot1/server/own"):
            assert (await node.create_client(Add, name).call(ask(1, 2))).sum == 3


@pytest.mark.parametrize("state", ["new", "destroyed"])
async def test_use_of_a_node_that_does_not_run_is_refused(state):
    node = memory()
    if state == "destroyed":
        await node.start()
        await node.destroy()
    said = "the node node has not started; write `async"
    with pytest.raises(taskrpc.TaskRpcError, match=said):
        node.create_client(Add, "add")
    with pytest.raises(taskrpc.TaskRpcError, match=said):
        node.create_service(Add, "add", add)
    with pytest.raises(taskrpc.TaskRpcError, match=said):
        await node.graph()


async def test_methods_of_a_destroyed_node_and_its_parts_may_be_called():
    async with memory("other") as other:
        node = memory()
        await node.start()
        service = node.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        await node.destroy()
        await node.destroy()
        await node.drain()
        service.destroy()
        client.destroy()
        assert not client.service_is_ready()
        for refused in (client.wait_for_service(1), client.call(ask())):
            with pytest.raises(taskrpc.TaskRpcError, match="the client of /add is destroyed"):
                await refused
        assert [entry.services for entry in await other.graph()] == [()]


async def test_a_node_may_start_again():
    node = memory()
    for _ in range(3):
        async with node:
            node.create_service(Add, "add", add)
            assert (await node.create_client(Add, "add").call(ask(1))).sum == 1


async def test_error_names_an_unknown_transport():
    with pytest.raises(taskrpc.TaskRpcError, match="expected 'tcp'"):
        await taskrpc.Node("node", transport="pigeon").start()


async def test_class_that_is_not_a_service_type_is_refused():
    async with memory() as node:
        for wrong, shown in ((Add.Request, "the class AddTwoInts_Request"), (42, "got 42")):
            with pytest.raises(TypeError, match=shown):
                node.create_client(wrong, "add")
            with pytest.raises(TypeError, match=shown):
                node.create_service(wrong, "add", add)


@pytest.mark.parametrize("concurrency", [0, -1, 2.5, "3"])
async def test_concurrency_that_is_no_whole_number_from_one_is_refused(concurrency):
    async with memory() as node:
        refusal = f"concurrency of /add: expected a whole number from 1 on, .*, got {concurrency!r}"
        with pytest.raises(ValueError, match=refusal):
            node.create_service(Add, "add", add, concurrency=concurrency)
        node.create_service(Add, "add", add)


async def test_error_that_ends_the_block_is_raised_unchanged():
    async def fail():
        async with memory() as node:
            node.create_service(Add, "add", add)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        await fail()


async def test_cancelled_spin_answers_the_calls_in_flight():
    gate = Gate()
    async with memory("client", token="c") as node:

        async def serve():
            async with memory("server", token="s") as server:
                server.create_service(Add, "gate", gate)
                await server.spin()

        serving = asyncio.create_task(serve())
        client = node.create_client(Add, "gate")
        assert await client.wait_for_service(60)
        call = client.call_async(ask(1))
        await until(lambda: gate.started)
        serving.cancel()
        await asyncio.sleep(3)
        assert not serving.done()
        assert isinstance(await outcome(client.call(ask(2))), taskrpc.ServiceUnavailable)
        gate.opened.set()
        assert (await call).sum == 1
        with pytest.raises(asyncio.CancelledError):
            await serving


@pytest.mark.real_time
@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="Windows cannot raise SIGTERM softly")
@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
async def test_one_signal_ends_every_node_that_spins(number):
    async with memory("one") as one, memory("other") as other:
        spinning = asyncio.gather(one.spin(), other.spin())
        await asyncio.sleep(0.01)
        signal.raise_signal(getattr(signal, number))
        await asyncio.wait_for(spinning, 60)


async def test_nodes_with_equal_settings_share_an_endpoint_until_the_last_is_destroyed():
    one, other = memory("one"), memory("other")
    await one.start()
    await other.start()
    assert one._transport is other._transport
    endpoint = one._transport
    other.create_service(Add, "add", add)
    await one.destroy()
    async with memory("third") as third:
        assert third._transport is endpoint
        assert (await third.create_client(Add, "add").call(ask(1))).sum == 1
    await other.destroy()
    async with memory("fourth") as fourth:
        assert fourth._transport is not endpoint


def test_run_returns_the_result_of_its_coroutine_and_leaves_no_loop():
    async def main():
        async with memory() as node:
            node.create_service(Add, "add", add)
            return (await node.create_client(Add, "add").call(ask(2, 3))).sum

    assert taskrpc.run(main()) == 5
    with pytest.raises(RuntimeError):
        asyncio.get_running_loop()


def test_fast_loop_is_from_uvloop_or_asyncio():
    factory = fast_loop()
    assert factory is None or factory.__module__.startswith("uvloop")


@pytest.mark.parametrize("transport", ["memory", "tcp"])
@pytest.mark.real_time
async def test_destroyed_clients_and_services_are_forgotten_by_the_node(transport):
    async def come_and_go(count):
        for _ in range(count):
            client = node.create_client(Add, "add")
            service = node.create_service(Add, "sum", add)
            client.destroy()
            service.destroy()
            gone.extend((weakref.ref(client), weakref.ref(service)))
            await asyncio.sleep(0)

    gone = []
    async with taskrpc.Node("node", transport=transport) as node:
        await come_and_go(5)
        (before,) = await node.graph()
        await come_and_go(50)
        assert await node.graph() == [before]
        assert (before.clients, before.services) == ((), ())
        assert not node._clients
        assert not node._services
        del before
        gc.collect()
        assert [each for each in gone if each() is not None] == []


async def test_node_keeps_a_destroyed_service_until_its_last_response():
    gate = Gate()
    async with memory("server") as server, memory() as node:
        service = server.create_service(Add, "add", gate)
        call = asyncio.ensure_future(node.create_client(Add, "add").call(ask(1, 2)))
        await until(lambda: gate.started)
        service.destroy()
        assert list(server._services) == [service]
        gate.opened.set()
        await call
        await until(lambda: not server._services)
