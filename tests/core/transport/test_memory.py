"""Programs in memory see each other within one event loop and domain."""

import asyncio
from contextvars import ContextVar

import pytest

import taskrpc
from tests.core.transport.helpers import Add, add, ask


async def test_domains_do_not_see_each_other(monkeypatch):
    async with taskrpc.Node("server", transport="memory") as server:
        server.create_service(Add, "add", add)
        monkeypatch.setenv("ROS_DOMAIN_ID", "1")
        async with taskrpc.Node("client", transport="memory") as node:
            assert not await node.create_client(Add, "add").wait_for_service(1)


def test_loops_do_not_see_each_other():
    async def offers(then):
        async with taskrpc.Node("server", transport="memory") as server:
            server.create_service(Add, "add", add)
            return await asyncio.to_thread(then)

    def looks():
        async def main():
            async with taskrpc.Node("client", transport="memory") as node:
                return await node.create_client(Add, "add").wait_for_service(0.05)

        return asyncio.run(main())

    assert asyncio.run(offers(looks)) is False


async def test_hours_of_calls_leave_nothing_behind():
    async with taskrpc.Node("node", transport="memory") as node:
        node.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        for n in range(4):
            assert (await client.call(ask(n))).sum == n
            await asyncio.sleep(3600)
        assert len(node._transport._served) == 1


async def test_accounts_hold_in_memory_as_they_do_on_sockets():
    ana = taskrpc.Account("ana", "anas-secret-anas")
    gone = taskrpc.Account("gone", "gones-secret-gone", revoked=True)
    async with (
        taskrpc.Node(
            "server", transport="memory", listen="s", accounts=taskrpc.Accounts([ana, gone])
        ) as server,
        taskrpc.Node("ana", transport="memory", listen="a", token=ana.token) as hers,
        taskrpc.Node("gone", transport="memory", listen="g", token=gone.token) as theirs,
        taskrpc.Node("any", transport="memory", listen="x") as mine,
    ):
        server.create_service(Add, "add", add)
        server.create_service(Add, "steer", add, role=taskrpc.Role.OPERATE)
        assert (await hers.create_client(Add, "add").call(ask(1, 2))).sum == 3
        with pytest.raises(taskrpc.PermissionDenied, match="the account ana has submit"):
            await hers.create_client(Add, "steer").call(ask())
        with pytest.raises(taskrpc.AuthenticationFailed, match="the token"):
            await theirs.create_client(Add, "add").call(ask())
        assert (await mine.create_client(Add, "steer").call(ask(1, 2))).sum == 3


async def test_a_handler_runs_in_the_context_of_its_own_program():
    program = ContextVar("program", default="")
    seen = []

    async def note(request, response):
        seen.append(program.get())
        return response

    async def serve():
        program.set("server")
        node = taskrpc.Node("server", transport="memory", listen="server")
        await node.start()
        node.create_service(Add, "add", note)
        return node

    server = await asyncio.create_task(serve())
    program.set("client")
    async with taskrpc.Node("client", transport="memory", listen="client") as client:
        await client.create_client(Add, "add").call(Add.Request(), timeout=5)
    await server.destroy()
    assert seen == ["server"]
