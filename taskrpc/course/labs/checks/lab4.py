"""Lab 4: a client with timeouts, retries with growing waits, and one id for all attempts."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

import srvgen
from taskrpc.course.labs.checks.common import ended, expect_spun
from taskrpc.course.labs.lab import Check, Lab, NotMet
from taskrpc.course.labs.trial import Program, Trial
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import HandlerError

_FILE = "lab4_interfaces/srv/Move.srv"
_NAMES = ("move_robot", "drive_robot", "go_to", "send_robot", "guide_robot")
_TARGETS = ("warehouse", "station_1", "area_a", "central", "dock")
_TIMES = ((4, 1.0, 1.0), (3, 0.9, 1.5), (4, 1.2, 0.9), (3, 1.0, 2.0))
STARTED = 30.0
"""Seconds that a program has to send its first request, or to end after its last one."""
_MEASUREMENTS = 2
"""How often the waits are measured: a busy machine can spoil a measurement."""


class Retry(msgspec.Struct, frozen=True):
    """The numbers of a variant: attempts, the timeout of each, the first wait."""

    attempts: int
    timeout: float
    first_wait: float

    def wait(self, number: int) -> float:
        """Return the seconds between an attempt, counted from 1, and the next one."""
        return float(self.first_wait * 2 ** (number - 1))

    @property
    def total(self) -> float:
        """The seconds until the client ends its attempts."""
        waits = sum(self.wait(number) for number in range(1, self.attempts))
        return self.attempts * self.timeout + waits


def retry_of(variant: Variant) -> Retry:
    """Return the numbers of a variant."""
    return Retry(*variant.choose("retry", _TIMES))


def targets_of(variant: Variant) -> Sequence[str]:
    """Return the targets of a variant."""
    return variant.order("targets", _TARGETS)


def _values(variant: Variant) -> Mapping[str, str]:
    retry = retry_of(variant)
    return {
        "SERVICE": variant.choose("service", _NAMES),
        "TARGET": targets_of(variant)[0],
        "ATTEMPTS": str(retry.attempts),
        "TIMEOUT": str(retry.timeout),
        "FIRST_WAIT": str(retry.first_wait),
    }


class Robot:
    """The robot of a check: it notes when each request arrives, and which tasks it runs.

    Args:
        trial: the trial of the check.
        lose: how many responses to each target get lost.
        late: the seconds after which a response that would be lost is sent all the same.
        accepts: whether it accepts a task.
        fails: whether the callback raises instead of losing the response.
    """

    def __init__(
        self,
        trial: Trial,
        *,
        lose: int = 0,
        late: float = 0.0,
        accepts: bool = True,
        fails: bool = False,
    ) -> None:
        self.requests: list[Any] = []
        self.times: list[float] = []
        self.runs: list[str] = []
        self._trial = trial
        self._lose = lose
        self._late = late
        self._accepts = accepts
        self._fails = fails
        self._number = trial.unpredictable(10**6, 10**7 - 1)
        self._known: set[str] = set()
        self._arrived = asyncio.Event()

    @contextlib.asynccontextmanager
    async def offered(self) -> AsyncIterator[Robot]:
        """Offer the service while the block runs."""
        name = _values(self._trial.variant)["SERVICE"]
        node = self._trial.node
        service = node.create_service(_move(), f"/{name}", self._move, concurrency=100)
        try:
            yield self
        finally:
            service.destroy()

    def message(self, target: str) -> str:
        """Return the message of the response; no program can guess it."""
        return f"{'at' if self._accepts else 'no way to'} {target} ({self._number})"

    async def received(self, count: int, timeout: float) -> bool:
        """Wait until this many requests have arrived; False after the timeout."""
        waiting = asyncio.ensure_future(self._received(count))
        pausing = asyncio.ensure_future(self._trial.sleep(timeout))
        await asyncio.wait([waiting, pausing], return_when=asyncio.FIRST_COMPLETED)
        done = waiting.done()
        for each in (waiting, pausing):
            each.cancel()
        return done

    def waits(self, retry: Retry) -> list[float]:
        """Return the waits between attempts: from the end of one to the start of the next."""
        pairs = zip(self.times, self.times[1:], strict=False)
        return [later - earlier - retry.timeout for earlier, later in pairs]

    async def _received(self, count: int) -> None:
        while len(self.requests) < count:
            self._arrived.clear()
            await self._arrived.wait()

    async def _move(self, request: Any, response: Any) -> Any:
        self.times.append(self._trial.time())
        self.requests.append(request)
        self._arrived.set()
        if self._accepts and request.request_id not in self._known:
            self.runs.append(request.target)
        self._known |= {request.request_id} - {""}
        same = [one for one in self.requests if one.target == request.target]
        if len(same) <= self._lose:
            if self._fails:
                raise HandlerError("UNAVAILABLE", "the motor is not ready")
            await self._trial.sleep(self._late or 1e6)
        response.success = self._accepts
        response.message = self.message(request.target)
        return response


def _move() -> Any:
    text = (Path(__file__).parents[1] / "files" / "lab4" / _FILE).read_text(encoding="utf-8")
    return srvgen.define("lab4_interfaces/srv/Move", text)


async def end_of(program: Program, robot: Robot, seconds: float) -> int:
    """Return the exit code of the client, which may take this long; NotMet if it still runs."""
    if not await robot.received(1, STARTED) and await program.finished(0.0) is None:
        raise NotMet(
            "the client to send a request",
            f"it sent none within {STARTED:g} s",
            "what does it wait for? Compare send_once with the client of lab 1",
        )
    code = await program.finished(seconds + STARTED)
    if code is None:
        raise NotMet(
            f"the client to end after about {seconds:.0f} s",
            f"it still runs; it sent {_times(len(robot.requests))}",
            "what does it wait for now? Log a line before and after each step",
        )
    return code


def expect_response(program: Program, code: int, robot: Robot, target: str) -> None:
    """Raise NotMet if the client does not print the response to a target."""
    if not robot.requests:
        raise NotMet("the client to send a request", ended(program, code), "see call_async")
    if not any(robot.message(target) in line for line in program.output):
        raise NotMet(
            f"the client to print the message of the response, here {robot.message(target)!r}",
            ended(program, code),
            "does each function return the response to the one that called it?",
        )


def expect_one_run(robot: Robot, targets: Sequence[str]) -> None:
    """Raise NotMet if a task ran more than once, or not at all."""
    for target in sorted(set(targets), key=targets.index):
        ids = [request.request_id for request in robot.requests if request.target == target]
        tasks, runs = targets.count(target), robot.runs.count(target)
        if runs > tasks:
            reason = (
                "the requests had no request_id"
                if "" in ids
                else "each attempt had another request_id"
            )
            raise NotMet(
                f"the robot to run each task {target} once",
                f"it ran {runs} times for {_times(tasks, 'task')}: only the response was lost, and"
                f" {reason}",
                "by what can the robot see that it did this task already?",
            )
        if runs < tasks and ids:
            raise NotMet(
                f"the robot to run the tasks {', '.join(targets)}",
                f"it ran {target} {_times(runs, 'time')}: two tasks had the same request_id,"
                " so the robot took the second one for a repetition",
                "when does a new id have to be made?",
            )


async def _prints(trial: Trial) -> None:
    target = targets_of(trial.variant)[0]
    async with Robot(trial).offered() as robot:
        client = await trial.start("client.py", target)
        code = await end_of(client, robot, 1.0)
        expect_response(client, code, robot, target)
        if len(robot.requests) > 1:
            raise NotMet(
                "one request, because the robot responds to it",
                f"the client sent {_times(len(robot.requests))}",
                "after which line does the loop have to end?",
            )
        expect_spun(client)


async def _repeats(trial: Trial) -> None:
    target = targets_of(trial.variant)[1]
    retry = retry_of(trial.variant)
    async with Robot(trial, lose=1).offered() as robot:
        client = await trial.start("client.py", target)
        await robot.received(1, STARTED)
        # Ten times as long as it should take: a slow machine is no reason to fail.
        if not await robot.received(2, 10 * (retry.timeout + retry.first_wait)):
            code = await client.finished(0.0)
            raise NotMet(
                f"a second attempt after {retry.timeout:g} s without a response",
                "it waits for the first response until today"
                if code is None
                else ended(client, code),
                "which argument of spin_until_future_complete is a number of seconds?"
                if code is None
                else "what happens when send_once returns None?",
            )
        code = await end_of(client, robot, 1.0)
        expect_response(client, code, robot, target)


async def _runs_once(trial: Trial) -> None:
    first, second = targets_of(trial.variant)[:2]
    targets = [first, second, first]
    async with Robot(trial, lose=1).offered() as robot:
        client = await trial.start("client.py", *targets)
        retry = retry_of(trial.variant)
        code = await end_of(client, robot, 2 * (retry.timeout + retry.first_wait))
        expect_one_run(robot, targets)
        for target in targets:
            expect_response(client, code, robot, target)
        runs = robot.runs.count(second)
        later = await trial.start("client.py", second)
        await end_of(later, robot, retry.timeout)
        if robot.runs.count(second) == runs:
            raise NotMet(
                "the robot to run the task of a client that was started once more",
                "it took the task for a repetition: the second run of the program used a"
                " request_id of the first run",
                "a number begins anew in each run; which id is new in every program?",
            )


def expect_no_last_wait(seconds: float, retry: Retry) -> None:
    """Raise NotMet if the error line comes long after the end of the last attempt."""
    if seconds > retry.wait(retry.attempts) / 2:
        raise NotMet(
            "the error line right after the last attempt",
            f"it came about {seconds:.1f} s later",
            "no attempt follows the last one, so what is this wait for?",
        )


def expect_waits(waits: Sequence[float], retry: Retry) -> None:
    """Raise NotMet if the waits do not double."""
    wanted = [retry.wait(number) for number in range(1, retry.attempts)]
    pairs = list(zip(waits, wanted, strict=False))
    if len(waits) < len(wanted) or any(
        abs(wait - right) > 0.4 * retry.first_wait for wait, right in pairs
    ):
        raise NotMet(
            f"waits of {_seconds(wanted)} s between the attempts",
            f"it waited about {_seconds([max(wait, 0.0) for wait in waits])} s"
            if waits
            else "there was no second attempt",
            "the n-th wait is FIRST_WAIT times a power of 2; which power is it before attempt 2?",
        )


async def _gives_up(trial: Trial) -> None:
    retry = retry_of(trial.variant)
    target = targets_of(trial.variant)[3]
    for left in reversed(range(_MEASUREMENTS)):
        async with Robot(trial, lose=1000).offered() as robot:
            client = await trial.start("client.py", target)
            await client.wait_for_line(r"\[ERROR\]", retry.total + STARTED)
            ended_at = trial.time()
            code = await end_of(client, robot, retry.total)
            if len(robot.requests) != retry.attempts:
                raise NotMet(
                    f"{_times(retry.attempts)}, as ATTEMPTS says",
                    f"it sent {_times(len(robot.requests))}",
                    "how often does the body of the loop run?",
                )
            expect_one_line(client, code, target, retry)
            try:
                expect_waits(robot.waits(retry), retry)
                expect_no_last_wait(ended_at - robot.times[-1] - retry.timeout, retry)
            except NotMet:
                if left == 0:
                    raise
            else:
                return


def expect_one_line(program: Program, code: int, target: str, retry: Retry) -> None:
    """Raise NotMet if the client does not say in one line that it tries no more."""
    if any("Traceback" in line for line in program.output):
        raise NotMet(
            "one line that says that the client tries no more",
            f"a traceback; {ended(program, code)}",
            "what does the function return if there is no response?",
        )
    lines = [line for line in program.output if "[ERROR]" in line]
    # Without the time before it, which has digits of its own.
    texts = [line.rpartition("]: ")[2] for line in lines]
    if len(texts) != 1:
        raise NotMet(
            f"one error line with the target {target} and the number {retry.attempts}",
            f"there were {len(texts)}: {' / '.join(texts)}" if texts else "there was none",
            "self.get_logger().error(...) after the loop; an attempt logs a warning",
        )
    if target not in texts[0] or not re.search(rf"\b{retry.attempts}\b", texts[0]):
        raise NotMet(
            f"an error line with the target {target} and the number {retry.attempts}",
            f"the line is: {texts[0]}",
            "a reader of the log wants to know what failed, and how often it was tried",
        )


async def _rejected(trial: Trial) -> None:
    target = targets_of(trial.variant)[4]
    retry = retry_of(trial.variant)
    async with Robot(trial, accepts=False).offered() as robot:
        client = await trial.start("client.py", target)
        code = await end_of(client, robot, retry.total)
        if len(robot.requests) > 1:
            raise NotMet(
                "one request, because the robot responds with success=False",
                f"it sent the request {len(robot.requests)} times",
                "what would change until the next attempt? Retry lost responses only",
            )
        expect_response(client, code, robot, target)


def _times(count: int, what: str = "request") -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _seconds(waits: Sequence[float]) -> str:
    return ", ".join(f"{wait:.1f}" for wait in waits)


_FIRST = "the client prints the response"
_SECOND = "a lost response leads to a second attempt"

LAB = Lab(
    number=4,
    title="Timeouts and retries",
    minutes=25,
    goal="You can write a client that survives lost responses and runs no task twice.",
    files=("client.py", "robot.py", _FILE),
    values=_values,
    speed=8.0,  # its programs wait for seconds
    checks=(
        Check(_FIRST, 2, _prints),
        Check(_SECOND, 2, _repeats, needs=(_FIRST,)),
        Check("each task runs once", 2, _runs_once, needs=(_SECOND,)),
        Check("the waits double, and the client ends its attempts", 3, _gives_up, needs=(_SECOND,)),
        Check("a rejected task is not repeated", 1, _rejected, needs=(_FIRST,)),
    ),
)
