"""Lab 3: synchronous and asynchronous calls, and several calls in flight.

No check measures seconds. The service of the checks holds its responses back until the program has
done what it must do meanwhile: sent the other requests, printed a response, or let its timer tick.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

import srvgen
from taskrpc.course.labs.checks.common import STARTED, ended, remark
from taskrpc.course.labs.lab import Check, Lab, NotMet
from taskrpc.course.labs.trial import Program, Trial
from taskrpc.course.labs.variants import Variant

if TYPE_CHECKING:
    from srvgen.stubs.example_interfaces.srv import AddTwoInts

_TYPE: Final = "example_interfaces/srv/AddTwoInts"
_NAMES = ("slow_add", "slow_sum", "patient_add", "long_addition")
_CALLS = 3
_HELD = 10.0
"""Seconds for which a response is held back at most. Only wrong programs let them pass."""
_TICKS = 12
"""Ticks of 0.25 s while responses are held back: a program that sleeps for 1 s makes fewer."""

Pair = tuple[int, int]


def _pairs(variant: Variant) -> list[Pair]:
    first = variant.number("first", 1, 30)
    return [(first + index, 10 * (first + index)) for index in range(_CALLS)]


def _values(variant: Variant) -> Mapping[str, str]:
    return {"SERVICE": variant.choose("service", _NAMES), "PAIRS": repr(_pairs(variant))}


class HeldService:
    """The slow service: its responses wait until the check releases them.

    Each sum is a number that no addition gives, so that a client must print what it received.
    """

    def __init__(self, trial: Trial) -> None:
        self.received: list[Pair] = []
        """The requests, in the order in which they came."""
        self.most_in_flight = 0
        self.sums = {pair: trial.unpredictable(10**6, 10**7 - 1) for pair in _pairs(trial.variant)}
        self._in_flight = 0
        self._news = asyncio.Event()
        self._released: dict[Pair, asyncio.Event] = {pair: asyncio.Event() for pair in self.sums}

    async def respond(
        self, request: AddTwoInts.Request, response: AddTwoInts.Response
    ) -> AddTwoInts.Response:
        """The callback: waits until the request is released."""
        pair = (request.a, request.b)
        self._in_flight += 1
        self.most_in_flight = max(self.most_in_flight, self._in_flight)
        self.received.append(pair)
        self._news.set()
        if pair in self._released:
            await self._released[pair].wait()
        response.sum = self.sums.get(pair, 0)
        self._in_flight -= 1
        return response

    def release(self, pair: Pair) -> None:
        """Let the service respond to a request, also to one that comes later."""
        self._released[pair].set()

    def release_all(self) -> None:
        """Let the service respond to all requests."""
        for pair in self._released:
            self.release(pair)

    async def requests(self, trial: Trial, program: Program, count: int) -> bool:
        """Wait until so many requests came, at most as long as responses are held."""
        waiting = asyncio.ensure_future(self._until(count))
        limits = [program.finished(_HELD), trial.sleep(_HELD)]
        others = [asyncio.ensure_future(each) for each in limits]
        await asyncio.wait([waiting, *others], return_when=asyncio.FIRST_COMPLETED)
        for task in [waiting, *others]:
            task.cancel()
        return len(self.received) >= count

    async def _until(self, count: int) -> None:
        while len(self.received) < count:
            self._news.clear()
            await self._news.wait()


@contextlib.asynccontextmanager
async def held_service(trial: Trial) -> AsyncIterator[HeldService]:
    """Offer the slow service under the name of the variant."""
    held = HeldService(trial)
    name = f"/{_values(trial.variant)['SERVICE']}"
    service = trial.node.create_service(
        srvgen.load(_TYPE), name, held.respond, concurrency=2 * _CALLS
    )
    try:
        yield held
    finally:
        held.release_all()
        service.destroy()


def line_of(pair: Pair, total: int) -> str:
    """Return the line that a client must print for a response."""
    return f"{pair[0]} + {pair[1]} = {total}"


def _pattern(pair: Pair, total: int) -> str:
    return rf"(?<!\d){pair[0]} *\+ *{pair[1]} *= *{total}(?!\d)"


async def _running(client: Program, expected: str) -> None:
    """Raise NotMet if a client has reported a mistake, or has ended early."""
    code = await client.finished(timeout=0.0)
    if code and "NoneType" in "\n".join(client.output):
        look = "a future has no result before it is complete: read it in the done callback"
        raise NotMet(expected, ended(client, code), look)
    if said := remark(client):
        look = "a callback must return soon; so send with call_async, and go on in a done callback"
        if "no thread spins" in said:
            look = "which thread receives the response while this one waits?"
        raise NotMet(expected, said, look)
    if code is not None:
        look = "which line keeps the program running until all responses are there?"
        if code:
            look = "start it beside slow_server.py and read its output"
        raise NotMet(expected, ended(client, code), look)


async def _first_request(trial: Trial, held: HeldService, file: str) -> Program:
    """Start a client; returns when its first request has come, or raises NotMet."""
    client = await trial.start(file)
    expected = f"{file} to send a request to /{_values(trial.variant)['SERVICE']}"
    if not await held.requests(trial, client, 1):
        if await client.finished(timeout=0.0) == 0:
            raise NotMet(expected, ended(client, 0), "which step of yours sends the requests?")
        await _running(client, expected)
        happened = f"there was none within {_HELD:g} s"
        raise NotMet(expected, happened, "which line before the call does not return?")
    return client


async def all_sent(trial: Trial, held: HeldService) -> Program:
    """Start the asynchronous client; returns when all its requests are in flight."""
    client = await _first_request(trial, held, "async_client.py")
    expected = f"{_CALLS} requests before the first response"
    if not await held.requests(trial, client, _CALLS):
        await _running(client, expected)
        raise NotMet(
            expected,
            f"{len(held.received)} came, and the others waited for a response",
            "send all requests first: which line of send_all waits?",
        )
    return client


async def shows(trial: Trial, held: HeldService, client: Program, order: Sequence[Pair]) -> None:
    """Release the responses one by one; raises NotMet if the client does not print each at once."""
    for index, pair in enumerate(order):
        held.release(pair)
        if await client.wait_for_line(_pattern(pair, held.sums[pair]), timeout=_HELD):
            continue
        expected = f"the line `{line_of(pair, held.sums[pair])}` as soon as this response is there"
        printed = [line for line in client.output if "=" in line]
        if index == 0:
            await _running(client, expected)
        raise NotMet(
            expected,
            f"the client printed {' and '.join(map(repr, printed)) or 'no sum'}",
            "the responses come in another order than the requests: does each call have its own"
            " future and callback, with its own a and b? And does the client wait for all of them?",
        )


async def ticks(trial: Trial, client: Program, count: int) -> bool:
    """Wait until a client has printed so many more ticks, at most as long as responses are held."""
    before = sum("tick" in line for line in client.output)
    for _ in range(int(10 * _HELD)):
        if sum("tick" in line for line in client.output) >= before + count:
            return True
        await trial.sleep(0.1)
    return False


async def _one_after_another(trial: Trial) -> None:
    async with held_service(trial) as held:
        client = await _first_request(trial, held, "sync_client.py")
        pairs = _pairs(trial.variant)
        for index, pair in enumerate(pairs, 1):
            held.release(pair)
            expected = f"the line `{line_of(pair, held.sums[pair])}` after the response"
            if not await client.wait_for_line(_pattern(pair, held.sums[pair]), timeout=_HELD):
                await _running(client, expected)
                raise NotMet(
                    expected,
                    f"the client received {index} of {_CALLS} responses and printed no such line",
                    "print the sum of the response right after the call",
                )
            if index < _CALLS and not await held.requests(trial, client, index + 1):
                await _running(client, f"request {index + 1} after response {index}")
                raise NotMet(
                    f"request {index + 1} after response {index}",
                    f"{len(held.received)} came",
                    "call the service once for each pair",
                )
        code = await client.finished(timeout=STARTED)
        if said := remark(client):
            lines = [line for line in client.output if re.match(r"\w+Error: ", line)]
            raise NotMet(
                "a second thread that spins while client.call waits",
                f"the thread failed with {lines[0]}" if lines else said,
                "start the thread of step 1 before the first call",
            )
        if code != 0:
            happened = "it still runs" if code is None else ended(client, code)
            raise NotMet(
                "the client to end after the last response",
                happened,
                "a thread with daemon=True does not keep a program alive",
            )
        if held.received != pairs or held.most_in_flight != 1:
            raise NotMet(
                f"one request at a time, with the pairs {pairs}",
                f"the requests were {held.received}, {held.most_in_flight} at the same time",
                "client.call waits for the response: call it once for each pair",
            )


async def _in_flight_together(trial: Trial) -> None:
    async with held_service(trial) as held:
        await all_sent(trial, held)


async def _keeps_ticking(trial: Trial) -> None:
    async with held_service(trial) as held:
        client = await all_sent(trial, held)
        if not await ticks(trial, client, _TICKS):
            expected = "the timer to tick while the responses are pending"
            await _running(client, expected)
            raise NotMet(
                expected,
                f"it did not tick {_TICKS} times within {_HELD:g} s",
                "timers are callbacks, too: the program must spin, and must not sleep or wait in"
                " any other way",
            )


async def _shows_each_response(trial: Trial) -> None:
    async with held_service(trial) as held:
        client = await all_sent(trial, held)
        await shows(trial, held, client, list(reversed(_pairs(trial.variant))))
        code = await client.finished(timeout=STARTED)
        if code != 0:
            happened = "it still runs" if code is None else ended(client, code)
            raise NotMet(
                "the client to end after the last response, with exit code 0",
                happened,
                "which condition ends the loop around spin_once?",
            )


LAB = Lab(
    number=3,
    title="Synchronous and asynchronous calls",
    minutes=25,
    goal="You can choose between call and call_async, and keep a node responsive while it waits.",
    files=("sync_client.py", "async_client.py", "slow_server.py"),
    values=_values,
    checks=(
        Check("the synchronous client waits for each response", 3, _one_after_another),
        Check("the asynchronous client has three calls in flight", 3, _in_flight_together),
        Check(
            "its timer ticks while the responses are pending",
            2,
            _keeps_ticking,
            needs=("the asynchronous client has three calls in flight",),
        ),
        Check(
            "it shows each response when it comes",
            2,
            _shows_each_response,
            needs=("the asynchronous client has three calls in flight",),
        ),
    ),
)
