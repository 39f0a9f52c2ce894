"""One run of a scenario: it starts the programs, lets faults happen, and looks at what they do."""

from __future__ import annotations

import asyncio
import copy
import math
import re
import sys
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.simulation.interpreter.disk import Disk
from taskrpc.simulation.interpreter.interpreter import Interpreter
from taskrpc.simulation.interpreter.programs import (
    Process,
    Source,
    WrongClock,
    own_line,
)
from taskrpc.simulation.interpreter.refusals import CannotSimulate
from taskrpc.simulation.interpreter.stacks import Killed, Stop
from taskrpc.simulation.interpreter.threads import Handle
from taskrpc.simulation.interpreter.tracebacks import explained, failed_line
from taskrpc.simulation.interpreter.watchdog import LIMIT, NeverWaits
from taskrpc.simulation.run import calling, ends
from taskrpc.simulation.run.choices import Choices
from taskrpc.simulation.run.contents import Contents
from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.run.network import Hubs, RunNetwork
from taskrpc.simulation.run.observing import (
    NamedFault,
    RunFaults,
    RunObserver,
    is_hidden,
)
from taskrpc.simulation.run.trace import Event, Kind, Trace
from taskrpc.simulation.run.world import CallRecord, SimulatedWorld
from taskrpc.simulation.scenario import ProgramEntry, Scenario
from taskrpc.spi import Fault, FaultKind, Hub, current_program

START_WITHIN: Final = 0.5
"""Seconds within which all programs start."""

MAX_OUTPUT: Final = 1_000_000
"""Characters that the programs of one run may write."""

MAX_EVENTS: Final = 100_000
"""Events after which a run counts as one that never ends."""

_KILLED = -9
_STAMP = re.compile(r"(\[[A-Z]+\] )\[\d+\.\d+\] ")
"""The time in a line of rclpy's log."""
_OVERTAKEN = 1.0
"""The most seconds for which a request is held back, so that others overtake it."""
_SLOWEST = 0.02
"""The most seconds that a step of a slow program takes."""
_WRONG = (-3600.0, -2.0, 2.0, 3600.0)
"""Seconds by which a wrong clock is ahead."""
_MAX_CRASHES = 2
_CRASH_SHARES = (0.0, 0.02, 0.08, 0.25)
"""The shares of a program's events at which it is killed; each run draws one of them."""


class Failure(msgspec.Struct, frozen=True):
    """Why a run failed."""

    kind: str
    """What was found, in a few words: `invariant one_motion_at_a_time`, `exception in client`."""
    text: str
    """The message, or the traceback of the user's files."""


class Result(msgspec.Struct, frozen=True):
    """What a run was."""

    seed: int
    failure: Failure | None
    faults: tuple[str, ...]
    """The names of the faults that happened, in their order."""
    hash: str
    shape: int
    seconds: float
    """Virtual seconds."""
    events: tuple[Event, ...] = ()
    """All events, if the run was told to keep them."""


def kind_of(fault: str) -> str:
    """Return the kind of a fault from its name: `lose request`, `kill`."""
    words = fault.split()
    return words[0] if words[0] in ("kill", "slow", "part") else " ".join(words[:2])


class Run:
    """One run; `play` does it.

    Args:
        interpreter: the prepared interpreter.
        scenario: what to run.
        folder: that of the scenario's file; its files are those of the disk.
        sources: the programs' files.
        choices: all chance.
        tells: whether the events name the lines of the programs, and the run keeps the contents of
            calls.
    """

    def __init__(
        self,
        interpreter: Interpreter,
        scenario: Scenario,
        folder: Path,
        sources: dict[str, Source],
        choices: Choices,
        *,
        tells: bool = False,
    ) -> None:
        self.processes: dict[str, Process] = {}
        """By the values of `current_program`."""
        self.chance = choices.chance("product")
        """For taskrpc's own ids, secrets and waits."""
        self.trace = Trace()
        self.calls: list[CallRecord] = []
        self.contents = Contents(lambda: self.now) if tells else None
        self.faults_happened: list[str] = []
        self.failure: Failure | None = None
        self.disk = Disk(folder, interpreter.cannot)
        self._interpreter = interpreter
        self._stacks = interpreter.stacks
        self._scenario = scenario
        self._folder = folder
        self._sources = sources
        self._choices = choices
        self._tells = tells
        faults = scenario.fault_settings
        self._network = RunNetwork(choices, faults.delay, faults.cut, self.fault)
        self.hubs: dict[int, Hub] = Hubs(self.chance, self._network)
        self._world = SimulatedWorld(self)
        self._visible = 0
        """Events that the checks have seen."""
        self._printed = 0
        """Characters that the programs have written."""
        self._events_of: dict[str, int] = {}
        self._crashes: dict[str, int] = {}
        self._doomed: list[Process] = []
        """Programs to kill after the present step."""
        self._lines_of_calls: dict[tuple[str, str], deque[str]] = {}
        """The lines of calls that have not begun yet, by process and service."""
        self.messages: dict[str, list[Any]] = {}
        """The messages that were published, by topic."""
        self._unheard: dict[str, int] = {}
        """Messages that no subscription got when they were published, by topic."""
        self._partition = (math.inf, math.inf)
        """When two programs cannot reach each other: from, to."""
        self._apart = ("", "")
        self._apart_fault = ""
        self._coming: list[tuple[float, ProgramEntry, int]] = []
        """Programs that will start, with the time and the number of the start."""
        self.waits: list[str] = []
        """What the programs waited for at the end, if the run tells it."""
        self._offered: list[str] = []
        self._ended_at = 0.0

    # What the programs do

    @property
    def now(self) -> float:
        """Virtual seconds since the begin."""
        return self._stacks.now

    @property
    def is_calm(self) -> bool:
        """Whether faults are off."""
        return self._network.is_calm

    @property
    def names(self) -> Sequence[str]:
        """The names of the programs."""
        return [each.name for each in self._scenario.programs]

    @property
    def lives(self) -> Iterable[Process]:
        """All starts of all programs."""
        return self.processes.values()

    def note(self, kind: Kind, text: str, program: str = "", where: str = "") -> None:
        """Add an event."""
        self.trace.add(Event(self.now, program, kind, text, where))

    def present(self) -> Process | None:
        """Return the process that runs now."""
        return self.processes.get(current_program.get())

    def where(self, process: Process) -> str:
        """Return the line of the program's own code that is being run, if the run tells it."""
        if not self._tells:
            return ""
        folder = str(process.source.file.parent)
        frame: FrameType | None = sys._getframe(1)
        while frame is not None:
            if frame.f_code.co_filename.startswith(folder):
                return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
            frame = frame.f_back
        for stack in self._stacks.of(process.id):
            if (line := own_line(stack, folder)) is not None:
                return f"{Path(line[0]).name}:{line[1]}"
        return ""

    def asks(self, service: str) -> None:
        """A program makes a call, which its event loop begins later."""
        process = self.present()
        if self._tells and process is not None:
            lines = self._lines_of_calls.setdefault((process.id, service), deque())
            lines.append(self.where(process))

    def line_of_call(self, process: Process, service: str) -> str:
        """Return the line of the program that makes a call which begins now."""
        lines = self._lines_of_calls.get((process.id, service))
        return lines.popleft() if lines else self.where(process)

    def printed(self, process: Process, line: str) -> None:
        """A program has written a line."""
        self._printed += len(line) + 1
        if self._printed > MAX_OUTPUT:  # perhaps in one step, before `_watch` sees it
            self.fail(
                "endless output", f"{process.name} has written more than {MAX_OUTPUT} characters"
            )
            raise Killed
        process.lines.append(line)
        # The event has its time already, and is the same event at another time.
        self._happened("print", _STAMP.sub(r"\1", line) if line.startswith("[") else line, process)

    def ended(self, process: Process) -> None:
        """A program has ended."""
        if isinstance(process.error, NeverWaits):
            words = f"{process.name} ran for {LIMIT:g} s without waiting for anything"
            self.fail(
                f"{process.name} never waits",
                f"{words}\n{explained(process.error, process.folder)}",
            )
        elif process.error is not None:
            self.fail(f"exception in {process.name}", explained(process.error, process.folder))
            self._happened("raise", type(process.error).__name__, process)
        else:
            self._happened("end", f"ends with {process.exit_code}", process)
        self._doomed.append(process)

    def thread_failed(self, process: Process, error: BaseException) -> None:
        """An exception has ended a thread of a program, and the program goes on."""
        if process.is_gone or isinstance(error, SystemExit):
            return
        text = explained(error, process.folder)
        process.write(text)
        self.fail(f"exception in a thread of {process.name}", text)

    def refused(self, problem: str) -> None:
        """A program does something that cannot be simulated."""
        process = self._interpreter.process()
        if process is not None and not process.is_gone:  # not while a killed one ends
            self.failure = Failure(CannotSimulate.__name__, problem)

    def fault(self, name: str, program: str) -> None:
        """A fault has happened."""
        self.faults_happened.append(name)
        self.note("fault", name, program)

    def published(self, topic: str, message: object, subscriptions: int) -> None:
        """A program publishes a message, which so many subscriptions get."""
        process = self.present()
        if process is not None and not is_hidden(topic):
            self.messages.setdefault(topic, []).append(copy.deepcopy(message))
            if not subscriptions:
                self._unheard[topic] = self._unheard.get(topic, 0) + 1
            text = topic if subscriptions else f"{topic}; no subscription gets it now"
            self._happened("message", text, process)

    def fault_of_call(self, service: str, count: int) -> Fault | None:
        """Return the fault of a call, the `count`th that arrived at a service."""
        if self.is_calm:
            return None
        settings, process = self._scenario.fault_settings, self.present()
        for words, share, kind in (
            ("lose request", settings.lose_requests, FaultKind.LOSE_REQUEST),
            ("lose response", settings.lose_responses, FaultKind.LOSE_RESPONSE),
            ("duplicate request", settings.duplicate_requests, FaultKind.DUPLICATE_REQUEST),
            ("delay request", settings.reorder_requests, FaultKind.SLOW),
            ("refuse request", settings.busy, FaultKind.BUSY),
        ):
            name = f"{words} {count} of {service}"
            if self._choices.happens(name, share):
                late = self._choices.seconds(f"how late {name}", 0.0, _OVERTAKEN)
                seconds = late if kind is FaultKind.SLOW else 0.0
                program = "" if process is None else process.name
                return NamedFault(kind, seconds, name=name, program=program)
        return None

    def _happened(self, kind: Kind, text: str, process: Process) -> None:
        self.note(kind, text, process.name, self.where(process))
        self.seen(process)

    def seen(self, process: Process) -> None:
        """Count what a program did, and decide whether it is killed now."""
        name = process.name
        process.last_event = len(self.trace.events)
        if name not in self._scenario.fault_settings.crash or self.is_calm:
            return
        count = self._events_of[name] = self._events_of.get(name, 0) + 1
        share = self._crash_share(name)
        fault = f"kill {name} at its event {count}"
        if self._crashes.get(name, 0) < _MAX_CRASHES and self._choices.happens(fault, share):
            self._crashes[name] = self._crashes.get(name, 0) + 1
            self.faults_happened.append(fault)
            self._doomed.append(process)

    def _crash_share(self, name: str) -> float:
        return _CRASH_SHARES[int(self._choices.fraction(f"kill {name}") * len(_CRASH_SHARES))]

    # The run

    def play(self) -> Result:
        """Run the scenario to its end."""
        interpreter, stacks = self._interpreter, self._stacks
        interpreter.run = self
        stacks.enter = interpreter.enter
        Node.default_observer, Node.default_faults = RunObserver(self), RunFaults(self)
        try:
            self._plan_starts()
            self._plan_partition()
            self._advance(self._scenario.duration)
            self._check_at_end()
            self._offered = self._services()
            self.waits = self._waits_in_words() if self._tells else []
            self._ended_at = self.now
        finally:
            for process in self.processes.values():
                process.is_gone = True
            stacks.reset()
            self.disk.close()
            interpreter.leave()
            interpreter.run = None
        events = tuple(self.trace.events) if self._tells else ()
        return Result(
            self._choices.seed,
            self.failure,
            tuple(dict.fromkeys(self.faults_happened)),
            self.trace.hash(),
            self.trace.shape(),
            self._ended_at,
            events,
        )

    def coverage(self) -> Coverage:
        """Return what the run has reached."""
        found = Coverage(runs=1, seconds=self._ended_at)
        for call in self.calls:
            if call.program and not call.is_hidden:
                found.calls[call.service] = found.calls.get(call.service, 0) + 1
                if not call.ok:
                    found.unanswered[call.service] = found.unanswered.get(call.service, 0) + 1
        for service in self._offered:
            found.offered[service] = 1
        for topic, messages in self.messages.items():
            found.messages[topic] = len(messages)
        found.unheard = dict(self._unheard)
        for fault in self.faults_happened:
            kind = kind_of(fault)
            found.faults[kind] = found.faults.get(kind, 0) + 1
        return found

    def fail(self, kind: str, text: str) -> None:
        """Let the run fail; the first failure counts."""
        if self.failure is None:
            self.failure = Failure(kind, text)

    def _plan_starts(self) -> None:
        for index, entry in enumerate(self._scenario.programs):
            when = 0.1 * index
            if self._choices.happens("order of starts", 1.0):
                when = self._choices.seconds(f"start {entry.name}", 0.0, START_WITHIN)
            self._coming.append((when, entry, 1))

    def _plan_partition(self) -> None:
        """Choose two programs, and when they cannot reach each other."""
        names = sorted(each.name for each in self._scenario.programs)
        length = self._scenario.fault_settings.partition
        if length is None or len(names) < 2:
            return
        one, other = self._choices.chance("who is apart").sample(names, 2)
        fault = f"part {one} from {other}"
        if self._choices.happens(fault, 0.7):
            begin = self._choices.chance("when apart").expovariate(0.3)
            self._partition = begin, begin + self._choices.seconds("how long apart", *length)
            self._apart, self._apart_fault = (one, other), fault

    def _keep_apart(self) -> None:
        """Begin or end the partition if it is time."""
        begin, end = self._partition
        is_apart = begin <= self.now < end and not self.is_calm
        if is_apart and not self._network.silent:
            self.fault(self._apart_fault, self._apart[0])
        if is_apart:
            one, other = self._apart
            self._network.silent = {
                pair
                for a in self.processes.values()
                for b in self.processes.values()
                for pair in ((a.id, b.id), (b.id, a.id))
                if {a.name, b.name} == {one, other}
            }
        elif self._network.silent:
            self.note("fault", f"{self._apart[0]} reaches {self._apart[1]} again")
            self._network.heal()

    def _next_change(self, until: float) -> float:
        """Return when the run itself must do something."""
        calm = self._scenario.fault_settings.until
        moments = [until, calm, *self._partition, *(when for when, _, _ in self._coming)]
        return min((each for each in moments if each > self.now), default=until)

    def _advance(self, until: float) -> None:
        """Let the programs run until a time, or until they have ended or failed."""
        stacks = self._stacks
        while self.failure is None and self.now < until:
            self._start_due()
            if not self.is_calm and self.now >= self._scenario.fault_settings.until:
                self._network.calm_down()
            self._keep_apart()
            change = self._next_change(until)
            end = min(until, change)
            stop = stacks.run(end, self._choices.next, self._watch, self._is_quiet)
            self._end_doomed()
            if stop is Stop.IDLE:
                if not self._coming and not self._network.silent:
                    return
                stacks.now = max(stacks.now, change)

    def _start_due(self) -> None:
        due = sorted(each for each in self._coming if each[0] <= self.now)
        for each in due:
            self._coming.remove(each)
            self._start(each[1], each[2])

    def _start(self, entry: ProgramEntry, number: int) -> None:
        chance = self._choices.chance(f"random of {entry.name} {number}")
        process = Process(entry.name, number, self._sources[entry.name], self._stacks, chance, self)
        process.pid = 1000 * (1 + len(self.processes))
        self._handicap(process)
        self.processes[process.id] = process
        self.note("start", "starts" if number == 1 else "starts again", entry.name)
        process.start()

    def _handicap(self, process: Process) -> None:
        """Let a program be slow, or have a wrong clock."""
        settings, name = self._scenario.fault_settings, process.name
        if name in settings.slow and self._choices.happens(f"slow {name}", 0.5):
            step = self._choices.seconds(f"how slow {process.id}", 0.0, _SLOWEST)
            self._stacks.slowness[process.id] = step
            self.fault(f"slow {name}", name)
        if name in settings.wrong_clock and self._choices.happens(f"wrong clock {name}", 0.5):
            chance = self._choices.chance(f"clock of {process.id}")
            since = min(chance.expovariate(0.3), settings.until)
            process.clock = WrongClock(since, chance.choice((*_WRONG, None)))
            self.fault(f"wrong clock {name}", name)
            self.note("fault", f"the time of day {process.clock}", name)

    def _watch(self) -> bool:
        """Look at what a step has done; returns whether to stop the stacks."""
        events = self.trace.events
        if len(events) != self._visible:
            self._visible = len(events)
            if len(events) > MAX_EVENTS:
                self.fail("endless work", f"more than {MAX_EVENTS} events in {self.now:.1f} s")
            self._check(self._scenario.always_checks)
        return bool(self._doomed) or self.failure is not None

    def _is_quiet(self) -> bool:
        """Whether nothing has happened that `_watch` would look at."""
        is_seen = len(self.trace.events) == self._visible
        return is_seen and not self._doomed and self.failure is None

    def _end_doomed(self) -> None:
        doomed, self._doomed = self._doomed, []
        for process in doomed:
            if process.is_gone:
                continue
            process.is_gone = True
            if process.exit_code is None:
                process.exit_code = _KILLED
                self.note("crash", "is killed", process.name)
                restart = self._scenario.fault_settings.restart
                if restart is not None:
                    wait = self._choices.seconds(f"restart {process.id}", *restart)
                    entry = next(
                        each for each in self._scenario.programs if each.name == process.name
                    )
                    self._coming.append((self.now + wait, entry, process.number + 1))
            for stack in self._stacks.of(process.id):
                self._stacks.kill(stack)
            if process.exit_code == _KILLED:
                self.disk.crash(process.id, self._choices.chance(f"disk of {process.id}"))
            for hub in self.hubs.values():
                self._network.crash(process.id, hub)

    def _check(self, checks: Sequence[Any]) -> None:
        for check in checks:
            try:
                check(self._world)
            except AssertionError as error:
                line = failed_line(error, self._folder)
                self.fail(check.__name__, f"{error}\n{line}" if str(error) else line)
            except Exception as error:
                self.fail(check.__name__, explained(error, self._folder))

    def _check_at_end(self) -> None:
        self._network.calm_down()
        self._keep_apart()
        if self._coming:  # programs that were killed shortly before the end
            self._advance(max(when for when, _, _ in self._coming) + START_WITHIN)
        # A deadlock explains more than the check that fails because of it.
        if self.failure is None and (threads := ends.circle(self._stacks, self.processes)):
            self.fail("deadlock", threads)
        if self.failure is None:
            self._check(self._scenario.final_checks)
        if self.failure is None:
            self._look_for_waits()

    def call(self, service: str, fields: dict[str, object]) -> object:
        """Call a service for a check, and let the programs run meanwhile."""
        if not self.is_calm:
            raise TaskRpcError("world.call: only the functions of scenario.finally_ may call")
        results: list[object] = []

        def live() -> None:
            try:
                results.append(asyncio.run(calling.call(service, fields)))
            except Exception as error:
                results.append(error)

        token = current_program.set(calling.NAME)
        self._stacks.start(live, Handle())
        current_program.reset(token)
        end = self.now + 2 * calling.TIMEOUT
        while not results and self.now < end:
            stop = self._stacks.run(end, self._choices.next, lambda: bool(results))
            self._end_doomed()
            if stop is Stop.IDLE:
                break
        if not results:
            raise TaskRpcError(f"world.call: {service} did not answer")
        if isinstance(results[0], Exception):
            raise results[0]
        return results[0]

    def _services(self) -> list[str]:
        return sorted(
            {
                endpoint.name
                for hub in self.hubs.values()
                for tracked in hub.entries.values()
                for endpoint in tracked.services.values()
                # Few clients need all services of an action.
                if not is_hidden(endpoint.name) and "/_action/" not in endpoint.name
            }
        )

    def _waits_in_words(self) -> list[str]:
        found = []
        for process in self.processes.values():
            if not process.is_gone:
                found += ends.waits_of(self._stacks, process, self.calls)
        return found

    def _look_for_waits(self) -> None:
        """Find programs that wait for ever."""
        for process in self.processes.values():
            if process.is_gone:
                continue
            last = self.trace.events[process.last_event - 1].time if process.last_event else 0.0
            if words := ends.stuck(self._stacks, process, last):
                self.fail("a callback that never ends", words)
            if words := ends.polls(self._stacks, process, last):
                self.fail(f"{process.name} never waits", words)
            self._look_for_calls(process)

    def _look_for_calls(self, process: Process) -> None:
        """Find a call without a response that a program still waits for."""
        for call in self.calls:
            if call.ok is not None or call.process != process.id or call.is_hidden:
                continue
            if process.last_event <= call.began_at and self.now - call.began > ends.SILENCE:
                since = f"since {call.began:.2f} s"
                where = f" at {call.where}" if call.where else ""
                what = f"the response of {call.service}, which it called{where}"
                words = f"{process.name} waits {since} for {what}"
                self.fail("a call that nobody answers", f"{words}, and does nothing else")
