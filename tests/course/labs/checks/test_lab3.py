"""Lab 3's checks of both clients, in memory; `tests/labs` runs whole submissions."""

import asyncio

import pytest

import srvgen
from taskrpc import Node
from taskrpc.course.labs.checks.lab3 import LAB
from taskrpc.course.labs.lab import NotMet
from tests.labs.memory_trial import check_of, memory_trial

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
PAIRS = [(1, 10), (2, 20), (3, 30)]
SYNC = "the synchronous client waits for each response"
TOGETHER = "the asynchronous client has three calls in flight"
TICKS = "its timer ticks while the responses are pending"
SHOWS = "it shows each response when it comes"


def with_client(action):
    """Return a program that runs an action with a client of the slow service."""

    async def run(program):
        async with Node("client", transport="memory") as node:
            client = node.create_client(AddTwoInts, "slow_add")
            await client.wait_for_service()

            async def call(a, b):
                response = await client.call(AddTwoInts.Request(a=a, b=b), timeout=60)
                return f"{a} + {b} = {response.sum}"

            await action(program, call)

    return run


async def one_after_another(program, call):
    for pair in PAIRS:
        program.output.append(await call(*pair))


async def together(program, call):
    async def show(pair):
        program.output.append(await call(*pair))

    async def tick():
        while True:
            program.output.append("tick")
            await asyncio.sleep(0.25)

    ticking = asyncio.ensure_future(tick())
    await asyncio.gather(*map(show, PAIRS))
    ticking.cancel()


async def together_without_ticks(program, call):
    program.output += await asyncio.gather(*(call(*pair) for pair in PAIRS))


async def of_another_pair(program, call):
    async def show(pair):
        program.output.append((await call(*pair)).replace(f"{pair[0]} + {pair[1]}", "3 + 30"))

    await asyncio.gather(*map(show, PAIRS))


async def only_the_last(program, call):
    futures = [asyncio.ensure_future(call(*pair)) for pair in PAIRS]
    program.output.append(await futures[-1])
    raise SystemExit


async def adds_itself(program, call):
    for a, b in PAIRS:
        await call(a, b)
        program.output.append(f"{a} + {b} = {a + b}")


async def reports_a_deadlock(program, call):
    program.output.append("[taskrpc] ROS 2 would hang here for ever: Client.call in a callback")
    raise SystemExit(1)


async def reads_too_early(program, call):
    program.output.append("AttributeError: 'NoneType' object has no attribute 'sum'")
    raise SystemExit(1)


async def sends_nothing(program, call):
    program.output.append("the calls took 0.0 s")


async def fails_in_its_thread(program, call):
    program.output += ["TypeError: it is no tuple", "[taskrpc] ROS 2 would hang here for ever"]
    await one_after_another(program, call)


async def run_check(title, folder, action):
    file = "sync_client.py" if title == SYNC else "async_client.py"
    async with memory_trial(folder, {file: with_client(action)}) as trial:
        await check_of(LAB, title)(trial)


@pytest.mark.parametrize(
    ("title", "action"),
    [(SYNC, one_after_another), (TOGETHER, together), (TICKS, together), (SHOWS, together)],
)
async def test_right_client_passes(title, action, tmp_path):
    await run_check(title, tmp_path, action)


@pytest.mark.parametrize(
    ("title", "action", "words"),
    [
        (SYNC, together, "one request at a time, .* 3 at the same time"),
        (SYNC, adds_itself, "printed no such line"),
        (SYNC, sends_nothing, "exit code 0 and wrote: .*; which step of yours sends"),
        (SYNC, fails_in_its_thread, "the thread failed with TypeError: it is no tuple"),
        (TOGETHER, one_after_another, "3 requests before the first response; 1 came"),
        (TOGETHER, reports_a_deadlock, "Client.call in a callback; a callback must return soon"),
        (TOGETHER, reads_too_early, "a future has no result before it is complete"),
        (TICKS, together_without_ticks, "it did not tick 12 times"),
        (SHOWS, together_without_ticks, "`3 \\+ 30 = .*` as soon as .*printed no sum"),
        (SHOWS, of_another_pair, "with its own a and b"),
        (SHOWS, only_the_last, "printed '3 \\+ 30 = .*'; .*wait for all of them"),
    ],
)
async def test_wrong_client_is_explained(title, action, words, tmp_path):
    with pytest.raises(NotMet, match=words):
        await run_check(title, tmp_path, action)
