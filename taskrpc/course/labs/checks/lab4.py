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
from taskrpc.course.labs.trial import Program, Ran, Service, Simulated, Trial
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import HandlerError

_FILE = "lab4_interfaces/srv/Move.srv"
_TYPE = "lab4_interfaces/srv/Move"
_NAMES = ("move_robot", "drive_robot", "go_to", "send_robot", "guide_robot")
_TARGETS = ("warehouse", "station_1", "area_a", "central", "dock")
_TIMES = ((4, 1.0, 1.0), (3, 0.9, 1.5), (4, 1.2, 0.9), (3, 1.0, 2.0))
STARTED = 30.0
"""Seconds that a program has to send its first request, or to end after its last one."""
_SPARE = 60.0
"""Virtual seconds after those that a right program needs."""
_TOLERANCE = 0.2
"""How wrong a wait may be, as a share of the first wait: a client may look for responses in a loop
of its own."""


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

    async def simulated(self, seconds: float, *targets: str) -> Simulated:
        """Run the client in virtual time; it should take so many seconds."""
        name = _values(self._trial.variant)["SERVICE"]
        service = Service(_TYPE, _definition(), f"/{name}", self._respond)
        duration = seconds + _SPARE
        return await self._trial.simulate("client.py", *targets, duration=duration, service=service)

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

    def _respond(self, request: Any, time: float) -> Any:
        """Note a request; returns its response, None if that gets lost."""
        self.times.append(time)
        self.requests.append(request)
        self._arrived.set()
        if self._accepts and request.request_id not in self._known:
            self.runs.append(request.target)
        self._known |= {request.request_id} - {""}
        same = [one for one in self.requests if one.target == request.target]
        return None if len(same) <= self._lose else self._response(request)

    def _response(self, request: Any) -> Any:
        message = self.message(request.target)
        return _move().Response(success=self._accepts, message=message)

    async def _move(self, request: Any, _: Any) -> Any:
        response = self._respond(request, self._trial.time())
        if response is None:
            if self._fails:
                raise HandlerError("UNAVAILABLE", "the motor is not ready")
            await self._trial.sleep(self._late or 1e6)
            response = self._response(request)
        return response


def _definition() -> str:
    return (Path(__file__).parents[1] / "files" / "lab4" / _FILE).read_text(encoding="utf-8")


def _move() -> Any:
    return srvgen.define(_TYPE, _definition())


async def end_of(program: Program, robot: Robot, seconds: float) -> int:
    """Return the exit code of the client, which may take this long; NotMet if it still runs."""
    if not await robot.received(1, STARTED) and await program.finished(0.0) is None:
        raise _no_request(STARTED)
    return expect_end(await program.finished(seconds + STARTED), robot, seconds)


def expect_end(code: int | None, robot: Robot, seconds: float, problem: str = "") -> int:
    """Return the exit code of the client, which may take this long; NotMet if it still runs.

    `problem` is what the simulation says of it.
    """
    if code is None and not robot.requests:
        raise _no_request(seconds + _SPARE)
    if code is None:
        raise NotMet(
            f"the client to end after about {seconds:.0f} s",
            f"it still runs; it sent {_times(len(robot.requests))}"
            + f"; {problem}" * bool(problem),
            "what does it wait for now? Log a line before and after each step",
        )
    return code


def _no_request(seconds: float) -> NotMet:
    return NotMet(
        "the client to send a request",
        f"it sent none within {seconds:g} s",
        "what does it wait for? Compare send_once with the client of lab 1",
    )


def expect_response(program: Ran, code: int, robot: Robot, target: str) -> None:
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
    retry = retry_of(trial.variant)
    robot = Robot(trial, lose=1)
    seconds = len(targets) * (retry.timeout + retry.first_wait)
    client = await robot.simulated(seconds, *targets)
    code = expect_end(client.code, robot, seconds, client.problem)
    expect_one_run(robot, targets)
    for target in targets:
        expect_response(client, code, robot, target)
    runs = robot.runs.count(second)
    async with robot.offered():
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
        abs(wait - right) > _TOLERANCE * retry.first_wait for wait, right in pairs
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
    robot = Robot(trial, lose=1000)
    client = await robot.simulated(retry.total, target)
    code = expect_end(client.code, robot, retry.total, client.problem)
    if len(robot.requests) != retry.attempts:
        raise NotMet(
            f"{_times(retry.attempts)}, as ATTEMPTS says",
            f"it sent {_times(len(robot.requests))}",
            "how often does the body of the loop run?",
        )
    expect_one_line(client, code, target, retry)
    expect_waits(robot.waits(retry), retry)
    lines = zip(client.times, client.output, strict=True)
    said_at = next(time for time, line in lines if "[ERROR]" in line)
    expect_no_last_wait(said_at - robot.times[-1] - retry.timeout, retry)


def expect_one_line(program: Ran, code: int, target: str, retry: Retry) -> None:
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
    is_simulated=True,
    checks=(
        Check(_FIRST, 2, _prints),
        Check(_SECOND, 2, _repeats, needs=(_FIRST,)),
        Check("each task runs once", 2, _runs_once, needs=(_SECOND,)),
        Check("the waits double, and the client ends its attempts", 3, _gives_up, needs=(_SECOND,)),
        Check("a rejected task is not repeated", 1, _rejected, needs=(_FIRST,)),
    ),
)
