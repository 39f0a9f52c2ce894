"""Lets the callbacks of a program take turns at each step, so that a missing lock always shows.

Callbacks that run at the same time in several threads usually miss each other by far. Here, each
one waits before each instruction of Python until another one has carried out its next instruction.
"""

from __future__ import annotations

import threading
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from taskrpc.course.labs.sandbox import speed

_ENTRY = 0.1
"""Real seconds for which a callback waits for a second one."""
_STEP = 0.02
"""Real seconds after which a callback that makes no step is taken for blocked, as by a lock."""


class Turns:
    """The threads that run the same function at the same time, and who of them has made a step."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._steps: dict[int, int] = {}
        """For each thread in the function, how many steps it has made."""
        self._blocked: set[int] = set()

    def enter(self) -> None:
        """Begin the function; waits for another thread, so that both begin together."""
        with self._changed:
            self._steps[threading.get_ident()] = 0
            self._changed.notify_all()
            self._changed.wait_for(lambda: len(self._steps) > 1, _ENTRY * speed.speed())

    def step(self) -> None:
        """Make a step; waits until another thread makes one too."""
        own = threading.get_ident()
        with self._changed:
            self._steps[own] += 1
            self._blocked.discard(own)
            self._changed.notify_all()
            others = self._steps.keys() - self._blocked - {own}
            if not others:
                return
            before = {each: self._steps[each] for each in others}
            if not self._changed.wait_for(
                lambda: any(self._steps.get(each) != steps for each, steps in before.items()),
                _STEP * speed.speed(),
            ):
                self._blocked |= others & self._steps.keys()

    def leave(self) -> None:
        """End the function."""
        with self._changed:
            del self._steps[threading.get_ident()]
            self._blocked.discard(threading.get_ident())
            self._changed.notify_all()


class Tracer:
    """Traces the functions of a program's own files, in threads that start from now on."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._is_own: dict[str, bool] = {}
        """For each file name of a code object, whether the file is in the folder."""
        self._turns: dict[CodeType, Turns] = {}
        self._local = threading.local()

    def called(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Trace a function of the program: take turns within, from the outermost one on."""
        name = frame.f_code.co_filename
        if name not in self._is_own:
            path = self._folder / name  # the program itself has a relative name
            self._is_own[name] = path.suffix == ".py" and path.is_relative_to(self._folder)
        if not self._is_own[name]:
            return None
        frame.f_trace = self._stepped  # without it, Python 3.13 ignores the next line
        frame.f_trace_opcodes = True
        if getattr(self._local, "outermost", None) is None:
            self._local.outermost = frame
            self._local.turns = self._turns.setdefault(frame.f_code, Turns())
            self._local.turns.enter()
        return self._stepped

    def _stepped(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == "opcode":
            self._local.turns.step()
        elif event == "return" and self._local.outermost is frame:
            self._local.outermost = None
            self._local.turns.leave()
        return self._stepped


def install(folder: Path) -> None:
    """Let all threads that start from now on take turns in the functions of a folder's files."""
    threading.settrace(Tracer(folder).called)
