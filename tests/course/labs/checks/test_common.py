"""What the checks of all labs find out about a program, in memory."""

import asyncio

import pytest

import srvgen
from taskrpc import Node
from taskrpc.course.labs.checks.common import (
    answer,
    has_client,
    offered_services,
    remark,
    service_of,
)
from taskrpc.course.labs.lab import NotMet
from tests.labs.memory_trial import memory_trial

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def server(name, callback):
    """Return a program that offers a service until it is stopped."""

    async def run(program):
        async with Node("server", transport="memory") as node:
            node.create_service(AddTwoInts, name, callback)
            await asyncio.Event().wait()

    return run


def add(request, response):
    response.sum = request.a + request.b
    return response


async def test_client_of_an_offered_service_gets_its_response(tmp_path):
    async with memory_trial(tmp_path, {"server.py": server("add", add)}) as trial:
        program = await trial.start("server.py")
        client = await service_of(trial, program, AddTwoInts, "/add")
        assert (await answer(client, AddTwoInts.Request(a=2, b=3), "a=2 b=3")).sum == 5
        assert await offered_services(trial) == ["/add (example_interfaces/srv/AddTwoInts)"]


async def test_service_of_another_name_is_named(tmp_path):
    async with memory_trial(tmp_path, {"server.py": server("plus", add)}) as trial:
        program = await trial.start("server.py")
        with pytest.raises(NotMet, match=r"offer the service /add; it offers /plus \(example_in"):
            await service_of(trial, program, AddTwoInts, "/add")


async def test_program_that_ends_is_reported_with_its_last_line(tmp_path):
    async def ends(program):
        program.output.append("the last line")
        raise SystemExit(1)

    async with memory_trial(tmp_path, {"server.py": ends}) as trial:
        program = await trial.start("server.py")
        with pytest.raises(NotMet, match=r"ended with exit code 1 and wrote: the last line; start"):
            await service_of(trial, program, AddTwoInts, "/add")


async def test_program_without_a_service_is_reported(tmp_path):
    async def runs(program):
        await asyncio.Event().wait()

    async with memory_trial(tmp_path, {"server.py": runs}) as trial:
        program = await trial.start("server.py")
        with pytest.raises(NotMet, match="it runs, but offered no service within 20 s"):
            await service_of(trial, program, AddTwoInts, "/add")


async def test_callback_that_fails_or_never_responds_is_explained(tmp_path):
    async def silent(request, response):
        await asyncio.Event().wait()

    for callback, words in [(lambda *_: None, "the callback failed: "), (silent, "within 8 s")]:
        async with memory_trial(tmp_path, {"server.py": server("add", callback)}) as trial:
            client = await service_of(trial, await trial.start("server.py"), AddTwoInts, "/add")
            with pytest.raises(NotMet, match=words):
                await answer(client, AddTwoInts.Request(), "a=0 b=0")


async def test_client_of_a_program_is_seen(tmp_path):
    async def calls(program, name):
        async with Node("client", transport="memory") as node:
            node.create_client(AddTwoInts, name)
            await asyncio.sleep(5)

    async with memory_trial(tmp_path, {"client.py": calls}) as trial:
        assert await has_client(trial, await trial.start("client.py", "add"), "/add")
        assert not await has_client(trial, await trial.start("client.py", "plus"), "/times")


async def test_remark_of_taskrpc_is_found_in_the_output(tmp_path):
    async def prints(program):
        program.output += ["hello", "[taskrpc] ROS 2 would lose this request: no node"]

    async with memory_trial(tmp_path, {"client.py": prints}) as trial:
        program = await trial.start("client.py")
        await program.finished(1)
        assert remark(program) == "ROS 2 would lose this request: no node"
