"""Prepares this interpreter for simulations; it cannot be used for anything else afterwards.

`prepare` replaces threads, clocks, random bytes, event loops and output for the whole process. So
simulations run in processes of their own, which `taskrpc.simulation.search` starts.
"""

from __future__ import annotations

import asyncio
import atexit
import gc
import os
import random
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any, Protocol

from taskrpc.simulation.interpreter import disk as disks
from taskrpc.simulation.interpreter import watchdog
from taskrpc.simulation.interpreter.clocks import Clocks
from taskrpc.simulation.interpreter.loop import Policy, SimulatedLoop
from taskrpc.simulation.interpreter.programs import Output, OwnModules, Process
from taskrpc.simulation.interpreter.refusals import CannotSimulate, cannot_simulate, refuse
from taskrpc.simulation.interpreter.stacks import Stack, Stacks
from taskrpc.simulation.interpreter.state import ModuleState, Values
from taskrpc.simulation.interpreter.threads import replace_threads


class PresentRun(Protocol):
    """The run that uses the interpreter."""

    processes: dict[str, Process]
    """By the values of `current_program`."""
    chance: random.Random
    """For taskrpc's own ids, secrets and waits."""
    hubs: dict[int, Any]
    """The memory network, by domain."""
    disk: disks.Disk

    def thread_failed(self, process: Process, error: BaseException) -> None:
        """An exception has ended a thread of a program."""

    def refused(self, problem: str) -> None:
        """A program does something that cannot be simulated."""


class Interpreter:
    """The one interpreter of this process, and the run that uses it."""

    def __init__(self) -> None:
        self.stacks = Stacks()
        self.run: PresentRun | None = None
        """The present run."""
        self.state: ModuleState
        """Set once all modules are imported."""
        self._entered: Process | None = None
        self._outside: list[Values] = []

    def process(self) -> Process | None:
        """Return the process whose stack runs now; None outside of the stacks."""
        stack = self.stacks.current
        if stack is None or self.run is None:
            return None
        return self.run.processes.get(stack.program)

    def disk(self) -> tuple[disks.Disk, Process] | None:
        """Return the disk and the running program; None outside of programs."""
        process = self.process()
        if process is None or process.is_gone or self.run is None:
            return None
        return self.run.disk, process

    def cannot(self, what: str) -> CannotSimulate:
        """Return the error for something that the running program may not use."""
        process = self.process()
        assert process is not None
        assert self.run is not None
        error = cannot_simulate(what, process)
        self.run.refused(str(error))  # the program may catch the error
        return error

    def enter(self, stack: Stack) -> None:
        """Let the interpreter belong to the program of a stack."""
        process = None if self.run is None else self.run.processes.get(stack.program)
        if process is not self._entered:
            if self._entered is None:
                self._outside = self.state.take()
            else:
                self._entered.leave()
                self._entered.state = self.state.take()
            if process is None:
                self.state.put(self._outside)
            else:
                self.state.put(process.state or self.state.new())
                process.enter()
            self._entered = process

    def leave(self) -> None:
        """Let the interpreter belong to no program."""
        if self._entered is not None:
            self._entered.leave()
            self._entered.state = self.state.take()
            self.state.put(self._outside)
            self._entered = None

    def thread_failed(self, error: BaseException | None) -> None:
        """Report the exception that has ended the running thread."""
        process = self.process()
        if process is not None and self.run is not None and error is not None:
            self.run.thread_failed(process, error)

    def randbytes(self, n: int, /) -> bytes:
        """Return random bytes for the running program."""
        assert self.run is not None
        return self.run.chance.randbytes(n)

    def ahead(self) -> float:
        """Return how far the wall clock of the running program is ahead, in seconds."""
        process = self.process()
        if process is None or process.clock is None:
            return 0.0
        return process.clock.ahead(self.stacks.now)


_interpreter: Interpreter | None = None


def prepare() -> Interpreter:
    """Prepare this process, once; returns its interpreter."""
    global _interpreter
    if _interpreter is not None:
        return _interpreter
    found = _interpreter = Interpreter()
    watchdog.watch(lambda: None if found.run is None else found.stacks.steps)
    replace_threads(found.stacks, found.stacks.present_handle)
    Clocks(found.stacks, lambda: found).install()
    sys.modules["uvloop"] = None  # type: ignore[assignment]
    policy = Policy(found.stacks, lambda: _new_loop(found))  # type: ignore[abstract]
    asyncio.set_event_loop_policy(policy)
    real = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (Output(found.process, stream) for stream in real)
    sys.meta_path.insert(0, OwnModules(found.process))
    _replace_process_functions(found)
    threading.excepthook = lambda failed: found.thread_failed(failed.exc_value)
    # The ends of killed programs run while their objects are freed; nothing of it matters.
    sys.unraisablehook = lambda _: None
    shown = warnings.showwarning
    warnings.showwarning = lambda *about: None if found.process() is None else shown(*about)
    refuse(lambda: found.process() is not None, found.cannot)
    disks.install(found.disk)
    gc.disable()  # the worker collects between runs
    return found


def _new_loop(interpreter: Interpreter) -> SimulatedLoop:
    run = interpreter.run
    assert run is not None
    return SimulatedLoop(interpreter.stacks, run.chance, run.hubs)


def _replace_process_functions(interpreter: Interpreter) -> None:
    """Replace what a process has once: its number, its signals, the functions at its exit."""
    pid, register, unregister = os.getpid, atexit.register, atexit.unregister
    set_handler, handler = signal.signal, signal.getsignal

    def getpid() -> int:
        process = interpreter.process()
        return pid() if process is None else process.pid

    def register_function(function: Callable[..., Any], /, *given: Any, **named: Any) -> Any:
        process = interpreter.process()
        if process is None:
            return register(function, *given, **named)
        process.at_exit.append((function, given, named))
        return function

    def unregister_function(function: Callable[..., Any], /) -> None:
        process = interpreter.process()
        if process is None:
            unregister(function)
        else:
            process.at_exit[:] = [each for each in process.at_exit if each[0] != function]

    def signal_handler(number: int, action: Any, /) -> Any:
        process = interpreter.process()
        if process is None:
            return set_handler(number, action)
        before = getsignal(number)
        process.handlers[number] = action
        return before

    def getsignal(number: int, /) -> Any:
        process = interpreter.process()
        if process is None:
            return handler(number)
        first = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
        return process.handlers.get(number, first)

    os.getpid, atexit.register, atexit.unregister = getpid, register_function, unregister_function
    vars(signal).update(signal=signal_handler, getsignal=getsignal)
    if hasattr(signal, "pause"):
        vars(signal)["pause"] = lambda: interpreter.stacks.wait(lambda _: None, None)
    for name in "raise_signal", "alarm", "setitimer":
        if hasattr(signal, name):
            vars(signal)[name] = _refuse_signals(interpreter, getattr(signal, name))


def _refuse_signals(interpreter: Interpreter, real: Callable[..., Any]) -> Callable[..., Any]:
    def refused(*given: Any) -> Any:
        process = interpreter.process()
        if process is not None:
            raise interpreter.cannot("a signal")
        return real(*given)

    return refused
