"""A caller continues in the read that has its response, and may do there whatever it likes."""

import asyncio

import pytest

import taskrpc
from taskrpc.testing import VirtualTimeLoop
from tests.core.transport.helpers import Add, Gate, ask


def add(request, response):
    response.sum = request.a + request.b
    return response


class Lab:
    """A server, and a client whose calls of one turn are answered in one read."""

    def __init__(self, server, user):
        self.server, self.user = server, user
        self.client = user.create_client(Add, "add")

    @property
    def connection(self):
        return self.client.channel._connection


@pytest.fixture
async def lab():
    server = taskrpc.Node("server", transport="memory", listen="server")
    user = taskrpc.Node("user", transport="memory", listen="user")
    async with server, user:
        server.create_service(Add, "add", add)
        lab = Lab(server, user)
        assert await lab.client.wait_for_service(60)
        yield lab


async def test_caller_continues_before_what_was_planned_earlier_for_the_next_turn(lab):
    seen = []
    read = lab.connection.__class__.buffer_updated

    def observed(connection, nbytes):
        asyncio.get_running_loop().call_soon(seen.append, "the next turn")
        read(connection, nbytes)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lab.connection.__class__, "buffer_updated", observed)
        await lab.client.call(ask(1))
        seen.append("the caller")
        await asyncio.sleep(0)
    assert seen == ["the caller", "the next turn"]


async def test_current_task_and_context_variables_are_those_of_the_caller(lab):
    task = asyncio.current_task()
    await lab.client.call(ask(1))
    assert asyncio.current_task() is task
    async with asyncio.timeout(60):
        assert (await lab.client.call(ask(2, 3))).sum == 5


async def test_caller_that_continues_may_cancel_another_whose_response_is_in_the_same_read(lab):
    async def first():
        await lab.client.call(ask(1))
        second.cancel()

    async with asyncio.TaskGroup() as group:
        group.create_task(first())
        second = group.create_task(lab.client.call(ask(2)))
    assert second.cancelled()


async def test_caller_that_continues_may_destroy_its_client(lab):
    async def call(number):
        response = await lab.client.call(ask(number))
        lab.client.destroy()
        return response.sum

    assert await asyncio.gather(call(1), call(2), call(3)) == [1, 2, 3]


async def test_callers_of_one_read_send_their_next_requests_together(lab):
    async def calls():
        for number in range(3):
            await lab.client.call(ask(number))

    gate = Gate()
    lab.server.create_service(Add, "wait", gate)
    waiting = lab.user.create_client(Add, "wait")
    assert await waiting.wait_for_service(60)
    open_call = waiting.call_async(ask(0))  # without it, the first request is written alone
    await lab.client.call(ask(0))
    written = []
    pipe = lab.connection.transport
    write = pipe.write
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipe, "write", lambda data: (written.append(len(data)), write(data)))
        await asyncio.gather(*(calls() for _ in range(5)))
    assert len(written) == 3
    gate.opened.set()
    await open_call


async def test_future_of_a_call_serves_a_task_and_callbacks(lab):
    seen = []
    future = lab.client.call_async(ask(1, 1))
    future.add_done_callback(lambda done: seen.append(done.result().sum))

    async def wait():
        return (await future).sum

    assert await asyncio.gather(wait(), wait(), wait()) == [2, 2, 2]
    assert seen == [2]


@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt])
def test_caller_that_ends_the_program_ends_it_after_the_others_have_their_responses(error):
    answered = []

    async def leave(client):
        await client.call(ask(1))
        raise error("the end")

    async def call(client):
        answered.append((await client.call(ask(2))).sum)

    async def main():
        server = taskrpc.Node("server", transport="memory", listen="server")
        user = taskrpc.Node("user", transport="memory", listen="user")
        async with server, user:
            server.create_service(Add, "add", add)
            client = user.create_client(Add, "add")
            assert await client.wait_for_service(60)
            # The first request is written at once, the others together in one turn.
            await asyncio.gather(client.call(ask(0)), leave(client), call(client))

    with pytest.raises(error, match="the end"), asyncio.Runner(loop_factory=VirtualTimeLoop) as run:
        run.run(main())
    assert answered == [2]
