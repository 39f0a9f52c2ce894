"""What a contender is: a module with a server part and a client part.

The module has `serve(announce, options)`, which tells `announce(place, *helpers)` where it listens
(and the process ids of programs that work for it) and serves for ever, and `connect(place,
options)`, which returns a `Caller`. Either may be `async`; the two need not agree.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol

TWO_INTS = 1, 2
"""What every contender adds, at every call."""


class Announce(Protocol):
    """Tells the client's side where to connect."""

    def __call__(self, place: str, *helpers: int) -> None: ...


def _itself(answer: Any) -> Any:
    return answer


@dataclass(frozen=True)
class Caller:
    """A client part that is connected. What `add` and `echo` return is awaited if it is async.

    They return what the library itself returns, so that no layer of ours is measured; `sum_in` and
    `data_in` take the value out of it.
    """

    add: Callable[[int, int], Any]
    echo: Callable[[bytes], Any]
    sum_in: Callable[[Any], int] = _itself
    data_in: Callable[[Any], bytes] = _itself


@dataclass(frozen=True)
class Contender:
    """One line of the tables."""

    name: str
    module: str
    """In `benchmarks.contenders`."""
    loop: str = "asyncio"
    """`asyncio` or `uvloop`."""
    options: tuple[str, ...] = ()
    typed: bool = True
    """False for those who only send bytes to and fro: no encoding, no types, no errors."""
    needs: tuple[str, ...] = ()
    programs: tuple[str, ...] = ()
    distribution: str = ""
    """The package whose version is reported."""
    most_in_flight: int = 512
    """Blocking contenders need a thread a call."""
    shared: bool = False
    """Whether threads share one blocking caller, instead of one each."""
    one_process: bool = False
    idle: bool = False
    """Whether it takes part in the measurement of idle connections."""

    def load(self) -> ModuleType:
        """Its module."""
        return importlib.import_module(f"benchmarks.contenders.{self.module}")

    def missing(self) -> list[str]:
        """What is not installed here, of all that it needs."""
        modules = (*self.needs, *(["uvloop"] if self.loop == "uvloop" else []))
        programs = [name for name in self.programs if find_program(name) is None]
        return [name for name in modules if importlib.util.find_spec(name) is None] + programs


def find_program(name: str) -> str | None:
    """Where a program is; Debian keeps servers outside of a user's PATH."""
    import shutil  # costs a server's start as much as its event loop does

    more = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/usr/local/sbin"])
    return shutil.which(name, path=more)
