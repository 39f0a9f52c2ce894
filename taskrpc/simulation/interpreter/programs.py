"""The programs of a run: each is loaded into modules of its own, and ends as a process does."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import io
import itertools
import random
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final, Protocol

from taskrpc.simulation.interpreter.stacks import Killed, Stack, Stacks
from taskrpc.simulation.interpreter.state import Values
from taskrpc.simulation.interpreter.threads import Handle
from taskrpc.simulation.interpreter.tracebacks import explained
from taskrpc.spi import current_program


class Listener(Protocol):
    """Is told what programs do."""

    def printed(self, process: Process, line: str) -> None:
        """A program has written a line."""

    def ended(self, process: Process) -> None:
        """The main function of a program, and its threads, have ended; or it was killed."""


class Source:
    """A program's file, compiled once for all runs, and the modules beside it."""

    def __init__(self, file: Path, arguments: Sequence[str]) -> None:
        self.file = file
        self.arguments = list(arguments)
        self._code: dict[str, CodeType] = {}

    def code_of(self, path: str) -> CodeType:
        """Return the compiled code of a file. Raises OSError and SyntaxError."""
        code = self._code.get(path)
        if code is None:
            text = Path(path).read_bytes()
            code = self._code[path] = compile(text, path, "exec", dont_inherit=True)
        return code


class WrongClock:
    """The error of a program's time of day.

    Args:
        since: virtual seconds from which on it is wrong.
        ahead: seconds by which it is ahead; None: it stands still.
    """

    def __init__(self, since: float, ahead: float | None) -> None:
        self._since = since
        self._ahead = ahead

    def __str__(self) -> str:
        if self._ahead is None:
            return f"stands still from {self._since:.3f} s on"
        where = "ahead" if self._ahead > 0 else "behind"
        return f"is {abs(self._ahead):g} s {where} from {self._since:.3f} s on"

    def ahead(self, now: float) -> float:
        """Return how far the clock is ahead, in seconds."""
        if now < self._since:
            return 0.0
        return self._since - now if self._ahead is None else self._ahead


class Process:
    """One life of a program, from a start to its end.

    Args:
        name: the name of the program in the scenario.
        number: which start of the program this is, from 1.
        source: its file.
        stacks: the stacks of the run.
        chance: for `random` in the program.
        listener: is told what it does.
    """

    def __init__(
        self,
        name: str,
        number: int,
        source: Source,
        stacks: Stacks,
        chance: random.Random,
        listener: Listener,
    ) -> None:
        self.name = name
        self.number = number
        self.id = f"{name}#{number}"
        """The value of `current_program`; unique in a run."""
        self.source = source
        self.modules: dict[str, ModuleType] = {"random": own_random(chance)}
        """The modules that only this program has."""
        self.exit_code: int | None = None
        """None while it runs; -9 after it was killed."""
        self.error: BaseException | None = None
        """The exception that ended it."""
        self.lines: list[str] = []
        """What it has printed and logged."""
        self.last_event = 0
        """How many events the run had when this program last did something visible."""
        self.clock: WrongClock | None = None
        """None: its time of day is right."""
        self.pid = 0
        self.state: list[Values] = []
        """Its values of `ModuleState`; [] before it first runs."""
        self.folder = source.file.parent
        self.is_gone = False
        """Whether it has left the network."""
        self.handlers: dict[int, Any] = {}
        """Its signal handlers."""
        self.at_exit: list[tuple[Callable[..., object], tuple[Any, ...], dict[str, Any]]] = []
        self._threads: dict[str, Any] = {
            "_active": {},
            "_limbo": {},
            "_counter": itertools.count(1).__next__,
        }
        """The variables of `threading`."""
        self._stacks = stacks
        self._listener = listener
        self._rest = ""
        self._argv = [str(source.file), *source.arguments]

    def start(self) -> None:
        """Start the main thread."""
        token = current_program.set(self.id)
        try:
            thread = threading.Thread(target=self._main, name="MainThread", daemon=False)
            handle = Handle()
            # Without `start`, which waits until the thread runs.
            self._threads["_limbo"][thread] = thread
            self._threads["_main_thread"] = thread
            if hasattr(thread, "_handle"):
                setattr(thread, "_handle", handle)  # noqa: B010
            bootstrap = getattr(thread, "_bootstrap")  # noqa: B009
            self._stacks.start(bootstrap, handle)
        finally:
            current_program.reset(token)

    def _main(self) -> None:
        code = self._ran(self._execute)
        if self.is_gone:
            return
        self.exit_code = code
        self._join_threads()
        for function, given, named in reversed(self.at_exit):
            self._ran(lambda function=function, given=given, named=named: function(*given, **named))  # type: ignore[misc]
        if self._rest:
            self.write("\n")
        self._listener.ended(self)

    def write(self, text: str) -> None:
        """Write to the program's output."""
        if self.is_gone:
            return
        *lines, self._rest = (self._rest + text).split("\n")
        for line in lines:
            self._listener.printed(self, line)

    def enter(self) -> None:
        """Let the interpreter's modules and arguments be those of this program."""
        sys.modules.update(self.modules)
        sys.argv = self._argv
        vars(threading).update(self._threads)

    def leave(self) -> None:
        """Undo `enter`."""
        vars(threading).update(_OUTSIDE)
        for name in self.modules:
            sys.modules.pop(name, None)

    def _execute(self) -> None:
        path = str(self.source.file)
        main = ModuleType("__main__")
        main.__file__ = path
        main.__dict__["__builtins__"] = __builtins__
        self.modules["__main__"] = sys.modules["__main__"] = main
        exec(self.source.code_of(path), vars(main))

    def _ran(self, action: Callable[[], object]) -> int:
        """Run an action, report its exception, and return the exit code that it causes."""
        try:
            action()
        except SystemExit as end:
            if end.code is None or isinstance(end.code, int):
                return end.code or 0
            self.write(f"{end.code}\n")
            return 1
        except Killed:
            raise
        except BaseException as error:
            self.error = error
            self.lines += explained(error, self.folder).splitlines()
            return 1
        return 0

    def _join_threads(self) -> None:
        own = threading.current_thread()
        while others := [each for each in threading.enumerate() if each is not own]:
            living = [each for each in others if not each.daemon]
            if not living:
                return
            living[0].join()


def own_random(chance: random.Random) -> ModuleType:
    """Return a module `random` whose functions draw from `chance`."""

    class OwnRandom(random.Random):
        def __init__(self, x: Any = None) -> None:
            super().__init__(chance.getrandbits(64) if x is None else x)

    module = ModuleType("random", random.__doc__)
    for name in random.__all__:
        setattr(module, name, getattr(chance, name, getattr(random, name)))
    module.Random = OwnRandom  # type: ignore[attr-defined]
    return module


_OUTSIDE: Final = {
    name: vars(threading)[name] for name in ("_active", "_limbo", "_counter", "_main_thread")
}
"""The variables of `threading` outside of the programs."""


class OwnModules(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the modules beside the running program; they belong to this program alone."""

    def __init__(self, present: Callable[[], Process | None]) -> None:
        self._present = present

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find a module in the program's folder."""
        process = self._present()
        if process is None:
            return None
        folder = process.source.file.parent
        place = folder.joinpath(*fullname.split("."))
        if (file := place.with_suffix(".py")).is_file():
            return importlib.util.spec_from_file_location(fullname, file, loader=self)
        if (file := place / "__init__.py").is_file():
            return importlib.util.spec_from_file_location(
                fullname, file, loader=self, submodule_search_locations=[str(place)]
            )
        return None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        """Use the default."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Run the module's code."""
        process = self._present()
        assert process is not None
        process.modules[module.__name__] = module
        exec(process.source.code_of(module.__file__ or ""), vars(module))


class Output(io.TextIOBase):
    """`sys.stdout` and `sys.stderr`: writes to the output of the running program.

    What other code writes goes to the real stream.
    """

    encoding = "utf-8"

    def __init__(self, present: Callable[[], Process | None], real: Any) -> None:
        self._present = present
        self._real = real

    def write(self, text: str) -> int:
        """Write text."""
        process = self._present()
        if process is None:
            self._real.write(text)
        else:
            process.write(text)
        return len(text)

    def flush(self) -> None:
        """Do nothing, or flush the real stream."""
        if self._present() is None:
            self._real.flush()

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the number of the real stream."""
        number: int = self._real.fileno()
        return number


def own_line(stack: Stack, folder: str) -> tuple[str, int] | None:
    """Return the file and line of the user's code where a suspended stack is."""
    frame = stack.greenlet.gr_frame
    while frame is not None:
        if frame.f_code.co_filename.startswith(folder):
            return frame.f_code.co_filename, frame.f_lineno
        frame = frame.f_back
    return None
