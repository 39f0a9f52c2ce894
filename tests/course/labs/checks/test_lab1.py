"""Lab 1's checks of a client, in memory; `tests/labs` runs whole submissions."""

import asyncio

import pytest

import srvgen
from taskrpc import Node
from taskrpc.course.labs.checks.lab1 import LAB
from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.variants import Variant
from tests.labs.memory_trial import check_of, memory_trial

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def client(*lines, waits=True, calls=1):
    """Return a program that calls the service and prints lines, with the sum for `{}`."""

    async def run(program, a, b):
        async with Node("client", transport="memory") as node:
            client = node.create_client(AddTwoInts, "add_two_ints")
            if waits:
                await client.wait_for_service()
            for _ in range(calls):
                response = await client.call(AddTwoInts.Request(a=int(a), b=int(b)))
                program.output += [line.format(response.sum) for line in lines]

    return run


async def run_check(title, folder, program):
    async with memory_trial(folder, {"client.py": program}) as trial:
        await check_of(LAB, title)(trial)


async def test_client_that_prints_the_response_passes(tmp_path):
    await run_check("the client prints the response", tmp_path, client("the sum is {}."))


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (client("the sum"), "only the server adds"),
        (client("1{}"), "only the server adds"),
        (client("{}", calls=2), r"it sent (a=\d+ b=\d+) and \1; sys"),
    ],
)
async def test_client_that_does_something_else_is_explained(program, words, tmp_path):
    with pytest.raises(NotMet, match=words):
        await run_check("the client prints the response", tmp_path, program)


async def test_client_that_never_sends_is_explained(tmp_path):
    async def sends_nothing(program, a, b):
        program.output.append("done")

    with pytest.raises(NotMet, match="send one request to /add_two_ints; it ended with exit code"):
        await run_check("the client prints the response", tmp_path, sends_nothing)


async def test_client_that_waits_although_there_is_a_server_is_explained(tmp_path):
    async def waits_for_ever(program, a, b):
        await asyncio.Event().wait()

    with pytest.raises(NotMet, match=r"still runs, and sent no request; which loop does not end"):
        await run_check("the client prints the response", tmp_path, waits_for_ever)


async def test_client_that_waits_for_its_server_passes(tmp_path):
    (tmp_path / "client.py").write_text("self.client.wait_for_service()")
    await run_check("the client waits for its server", tmp_path, client("{}"))


async def test_the_call_may_be_in_a_module_beside_the_client(tmp_path):
    (tmp_path / "client.py").write_text("import helper")
    (tmp_path / "helper.py").write_text("client.wait_for_service()")
    await run_check("the client waits for its server", tmp_path, client("{}"))


def test_a_class_of_thirty_has_few_names_twice():
    names = {LAB.values(Variant(f"student{number}"))["SERVICE"] for number in range(30)}
    assert len(names) >= 28
    assert LAB.values(Variant())["SERVICE"] == "add_two_ints"


async def test_client_that_does_not_wait_is_explained(tmp_path):
    (tmp_path / "client.py").write_text("pass")
    with pytest.raises(NotMet, match=r"no file of the folder has a call of wait_for_service"):
        await run_check("the client waits for its server", tmp_path, client("{}"))


async def test_client_that_gives_up_without_a_server_is_explained(tmp_path):
    async def gives_up(program, a, b):
        raise SystemExit(1)

    with pytest.raises(NotMet, match="no server ran, and it ended with exit code 1"):
        await run_check("the client waits for its server", tmp_path, gives_up)
