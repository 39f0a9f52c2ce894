"""What is wrong with the programs that have not ended when nothing more happens."""

from __future__ import annotations

from pathlib import Path
from types import FrameType
from typing import Final

from taskrpc.simulation.interpreter.clocks import READS_A_CLOCK
from taskrpc.simulation.interpreter.programs import Process
from taskrpc.simulation.interpreter.stacks import Stack, Stacks
from taskrpc.simulation.interpreter.threads import Lock
from taskrpc.simulation.run.world import CallRecord

SILENCE: Final = 10.0
"""Seconds without anything visible after which a waiting program counts as one that waits for
ever."""

_SERVING = frozenset(
    {"spin", "spin_once", "spin_until_future_complete", "run_forever", "_run_once"}
)
"""Functions in which a program waits for what others send."""


_PRODUCT = str(Path(__file__).parents[2])


class Waiting:
    """One thread that waits, and where."""

    def __init__(self, process: Process, stack: Stack) -> None:
        self.process = process
        self.stack = stack
        self.inner: list[str] = []
        """The functions between the program's line and the wait, the innermost first."""
        self.line = ""
        """The program's line, such as `client.py:12`; "" if it runs none of its own."""
        self.is_callback = False
        """Whether taskrpc called the program's function."""
        self._look(stack.greenlet.gr_frame, str(process.folder))

    def _look(self, frame: FrameType | None, folder: str) -> None:
        own = called = False
        while frame is not None:
            file = frame.f_code.co_filename
            if file.startswith(folder):
                if not own:
                    own = True
                    self.line = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
            elif not own:
                self.inner.append(frame.f_code.co_name)
            elif not called and not file.startswith(_PRODUCT):
                return  # asyncio or threading has called it, as a main function
            else:
                called = True
                self.is_callback |= frame.f_code.co_name in _SERVING
            frame = frame.f_back

    @property
    def has_timeout(self) -> bool:
        """Whether the wait ends by itself."""
        return self.stack.waiter is None or self.stack.waiter.has_timeout

    @property
    def serves(self) -> bool:
        """Whether it waits for what others send."""
        return not _SERVING.isdisjoint(self.inner)


def circle(stacks: Stacks, processes: dict[str, Process]) -> str:
    """Return the threads that wait for each other's locks, "" if there are none."""
    living = [each for each in stacks.all.values() if not each.is_dead]
    for begin in [each for each in living if each.program in processes]:  # not of `world.call`
        chain: list[Stack] = []
        stack: Stack | None = begin
        while stack is not None and stack not in chain:
            chain.append(stack)
            lock = waited_for(stack)
            stack = None if lock is None else stacks.all.get(lock.owner)
        if stack is begin and (len(chain) > 1 or _takes_twice(stack, processes)):
            return "; ".join(_holds(each, processes) for each in chain)
    return ""


def waited_for(stack: Stack) -> Lock | None:
    """Return the lock for which a stack waits without a timeout."""
    waiter = stack.waiter
    if waiter is None or waiter.has_timeout or not isinstance(waiter.reason, Lock):
        return None
    return waiter.reason


def _takes_twice(stack: Stack, processes: dict[str, Process]) -> bool:
    """Whether a stack takes a lock that it has; a wait for a condition does that on purpose."""
    inner = Waiting(processes[stack.program], stack).inner
    return inner[-1:] in (["acquire"], ["__enter__"])


def _holds(stack: Stack, processes: dict[str, Process]) -> str:
    process = processes[stack.program]
    where = Waiting(process, stack).line or "taskrpc"
    lock = waited_for(stack)
    assert lock is not None
    return f"a thread of {process.name} waits at {where} for a lock that another of them holds"


def stuck(stacks: Stacks, process: Process, silent_since: float) -> str:
    """Return where a program waits for ever, "" if it does not."""
    if stacks.now - silent_since <= SILENCE:
        return ""
    waits = [Waiting(process, stack) for stack in stacks.of(process.id)]
    for each in waits:
        if each.line and not each.has_timeout and not each.serves and each.is_callback:
            return f"a callback of {process.name} waits for ever at {each.line}"
    return ""


def polls(stacks: Stacks, process: Process, silent_since: float) -> str:
    """Return where a program asks for something again and again, "" if it does not."""
    for stack in stacks.of(process.id):
        since = max(stack.polls_since or 0.0, silent_since)
        if stack.polls_since is not None and stacks.now - since > SILENCE:
            each = Waiting(process, stack)
            if READS_A_CLOCK in each.inner:
                words = f"{process.name} asks again and again at {each.line}, since {since:.2f} s"
                return f"{words}, and nothing in this thread changes what it asks for"
    return ""


def waits_of(stacks: Stacks, process: Process, calls: list[CallRecord]) -> list[str]:
    """Return what a program that has not ended waits for, one line for each of its own lines."""
    found = []
    for call in calls:
        if call.ok is None and call.process == process.id and not call.is_hidden:
            where = f" at {call.where}" if call.where else ""
            what = f"the response of {call.service}, which it called{where}"
            found.append(f"{process.name} waits for {what}")
    for each in (Waiting(process, stack) for stack in stacks.of(process.id)):
        if each.line and not any(each.line in line for line in found):
            what = (
                "for what others send"
                if each.serves
                else f"in {each.inner[-1]}"
                if each.inner
                else ""
            )
            found.append(f"{process.name} waits at {each.line} {what}".rstrip())
    return found
