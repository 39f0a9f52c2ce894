"""A process that simulates: it reads orders from stdin and answers on stdout, line by line."""

from __future__ import annotations

import gc
import os
import sys
import time
import traceback
from collections.abc import Collection, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.interpreter import interpreter as interpreters

if TYPE_CHECKING:  # importing it before `prepare` would be too early
    from taskrpc.simulation.run.run import Run
    from taskrpc.simulation.scenario import Scenario
    from taskrpc.simulation.search.protocol import Answer, Explained, Loaded, Order, Searched

_cpu_seconds = time.process_time  # before it is replaced for the programs
_COLLECT_EVERY: Final = 20  # runs


class Worker:
    """Loads a scenario, and runs its seeds."""

    def __init__(self) -> None:
        self._interpreter = interpreters.prepare()
        self._scenario: Any = None
        self._sources: dict[str, Any] = {}
        self._folder = Path()
        """The folder of the scenario's file."""
        self._runs = 0

    def answer(self, order: Order) -> Answer:
        """Do what an order says; returns the answer."""
        from taskrpc.simulation.search import protocol

        try:
            match order:
                case protocol.Load():
                    return self._load(Path(order.file))
                case protocol.Search():
                    return self._search(order.seeds)
                case protocol.Explain():
                    return self._explain(order.seed, records=order.records)
        except TaskRpcError as error:
            return protocol.Refused(str(error))

    def _load(self, file: Path) -> Loaded:
        from taskrpc.simulation.search import protocol

        file = file.resolve()  # before the working folder changes
        folder = file.parent
        os.chdir(folder)
        sys.path[0] = str(folder)
        known = set(sys.modules)
        try:
            scenario = _read(file)
        finally:
            _forget_modules(folder, known)
        self.use(scenario, folder)
        return protocol.Loaded([each.name for each in scenario.programs])

    def use(self, scenario: Scenario, folder: Path) -> None:
        """Prepare the programs of a scenario. Raises TaskRpcError."""
        from taskrpc.simulation.interpreter.programs import Source
        from taskrpc.simulation.run.product import use_product

        self._scenario = scenario
        self._sources = {}
        self._folder = folder
        for entry in scenario.programs:
            source = Source((folder / entry.file).resolve(), entry.arguments)
            try:
                source.code_of(str(source.file))
            except OSError as error:
                problem = f"program {entry.name}: cannot read {entry.file}: {error.strerror}"
                raise TaskRpcError(problem) from None
            except SyntaxError as error:
                raise TaskRpcError(f"{entry.file}:{error.lineno}: {error.msg}") from None
            self._sources[entry.name] = source
        files = [each.file for each in self._sources.values()]
        use_product(self._interpreter, folder, files)
        gc.freeze()  # `gc.collect` need not look at the modules again

    def _search(self, seeds: Sequence[int]) -> Searched:
        from taskrpc.simulation.interpreter.refusals import CannotSimulate
        from taskrpc.simulation.run.coverage import Coverage
        from taskrpc.simulation.search import protocol

        coverage, shapes, last = Coverage(), [], ""
        begin = _cpu_seconds()
        for seed in seeds:
            run = self.new_run(seed)
            result = run.play()
            coverage.add(run.coverage())
            shapes.append((seed, result.shape))
            last = result.hash
            if result.failure is not None:
                if result.failure.kind == CannotSimulate.__name__:
                    raise TaskRpcError(result.failure.text)
                return protocol.Searched(coverage, shapes, seed, last, _cpu_seconds() - begin)
        return protocol.Searched(coverage, shapes, None, last, _cpu_seconds() - begin)

    def _explain(self, seed: int, *, records: bool) -> Explained:
        from taskrpc.simulation.search import protocol
        from taskrpc.simulation.search.shrink import GROUPS, shrink
        from taskrpc.simulation.search.told_calls import contents_of

        first = self.new_run(seed).play()
        kept, in_order = shrink(
            first, lambda names, orderly: self.new_run(seed, names, orderly=orderly).play()
        )
        run = self.new_run(seed, kept, orderly=in_order, tells=True)
        last = run.play()
        assert last.failure is not None
        return protocol.Explained(
            seed,
            last.failure.kind,
            last.failure.text,
            [each for each in last.faults if each in kept],
            [each for each in GROUPS if each in kept],
            in_order,
            first.hash,
            list(last.events),
            run.waits,
            last.seconds,
            contents_of(run) if records else None,
        )

    def new_run(
        self,
        seed: int,
        kept: Sequence[str] | None = None,
        *,
        orderly: bool = False,
        tells: bool = False,
    ) -> Run:
        """Return a run of the scenario; its arguments are those of `Choices` and `Run`."""
        from taskrpc.simulation.run.choices import Choices
        from taskrpc.simulation.run.run import Run

        self._runs += 1
        if self._runs % _COLLECT_EVERY == 0:
            gc.collect()
        choices = Choices(seed, kept, orderly=orderly)
        return Run(
            self._interpreter, self._scenario, self._folder, self._sources, choices, tells=tells
        )


def _read(file: Path) -> Any:
    """Run a scenario's file; returns its `scenario`. Raises TaskRpcError."""
    from taskrpc.simulation.interpreter.tracebacks import explained
    from taskrpc.simulation.scenario import Scenario

    module = ModuleType(file.stem)
    module.__file__ = str(file)
    try:
        text = file.read_bytes()
    except OSError as error:
        raise TaskRpcError(f"cannot read {file.name}: {error.strerror}") from None
    try:
        exec(compile(text, str(file), "exec", dont_inherit=True), vars(module))
    except SyntaxError as error:
        raise TaskRpcError(f"{file.name}:{error.lineno}: {error.msg}") from None
    except TaskRpcError as error:
        raise TaskRpcError(f"{file.name}: {error}") from None
    except Exception as error:
        raise TaskRpcError(explained(error, file.parent).rstrip()) from None
    found = getattr(module, "scenario", None)
    if not isinstance(found, Scenario):
        got = "nothing with this name" if found is None else repr(found)
        raise TaskRpcError(f"{file.name}: expected `scenario = Scenario(...)`, got {got}")
    if not found.programs:
        raise TaskRpcError(
            f'{file.name}: the scenario has no programs; add scenario.program("robot", "robot.py")'
        )
    return found


def _forget_modules(folder: Path, known: Collection[str]) -> None:
    """Let the programs import the scenario's own modules anew, each for itself."""
    for name in sys.modules.keys() - known:
        top = name.partition(".")[0]
        places = folder / f"{top}.py", folder / top / "__init__.py"
        if top not in known and any(each.is_file() for each in places):
            del sys.modules[name]


def main() -> None:
    """Answer orders until stdin ends."""
    orders, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what anything else prints is no answer
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # no program reads the orders
    worker = Worker()
    from taskrpc.simulation.search import protocol

    decoder, encoder = msgspec.json.Decoder(protocol.Order), msgspec.json.Encoder()
    code = 1
    try:
        for line in orders:
            answers.write(encoder.encode(worker.answer(decoder.decode(line))) + b"\n")
            answers.flush()
        code = 0
    except Exception:
        traceback.print_exc()
    finally:
        os._exit(code)  # the threads of the programs are none that Python could wait for


if __name__ == "__main__":
    main()
