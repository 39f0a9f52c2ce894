"""Small scenarios, which one worker process of `taskrpc simulate` runs for all tests."""

from __future__ import annotations

import itertools
import json
import textwrap
from pathlib import Path
from typing import Any

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.search.protocol import Explain, Explained, Search, Searched
from taskrpc.simulation.search.search import WorkerProcess

_SEEN = """

@scenario.finally_
def _seen(world):
    import json
    from pathlib import Path

    seen = {
        "lines": {each.name: world.lines(each.name) for each in scenario.programs},
        "starts": {each.name: world.starts(each.name) for each in scenario.programs},
        "time": world.time,
    }
    (Path(__file__).parent / "seen.json").write_text(json.dumps(seen))
"""


class Outcome:
    """One run that did not fail."""

    def __init__(self, answer: Searched, seen: dict[str, Any]) -> None:
        self.hash = answer.hash
        self.coverage = answer.coverage
        self.lines: dict[str, list[str]] = seen["lines"]
        self.starts: dict[str, int] = seen["starts"]
        self.time: float = seen["time"]


class Simulated:
    """A scenario in the worker process."""

    def __init__(self, worker: WorkerProcess, file: Path) -> None:
        self.worker = worker
        self.file = file

    def search(self, *seeds: int) -> Searched:
        """Run seeds, up to the first that fails."""
        answer: Searched = self.worker.ask(Search(list(seeds)))
        return answer

    def run(self, seed: int = 0) -> Outcome:
        """Run a seed that must not fail."""
        answer = self.search(seed)
        if answer.failed is not None:
            failure = self.explain(seed)
            pytest.fail(f"{failure.kind}: {failure.text}")
        return Outcome(answer, json.loads(self.file.with_name("seen.json").read_text("utf-8")))

    def hash_of(self, seed: int) -> str:
        """Run a seed, which may fail, and return its hash."""
        return self.search(seed).hash

    def explain(self, seed: int = 0) -> Explained:
        """Explain a seed that fails."""
        assert self.search(seed).failed is not None, f"seed {seed} does not fail"
        answer: Explained = self.worker.ask(Explain(seed))
        return answer

    def first_failure(self, seeds: int = 200) -> Explained:
        """Explain the first of these seeds that fails."""
        failed = self.search(*range(seeds)).failed
        assert failed is not None, f"none of {seeds} seeds fails"
        return self.explain(failed)

    def refusal(self, seed: int = 0) -> str:
        """Run a seed that cannot be simulated; returns the reason."""
        with pytest.raises(TaskRpcError) as caught:
            self.search(seed)
        return str(caught.value)


class Workbench:
    """Writes scenarios into a folder, and loads them."""

    def __init__(self, worker: WorkerProcess, folder: Path) -> None:
        self.worker = worker
        self.folder = folder
        self._numbers = itertools.count(1)

    def write(self, more: str = "", *, duration: float = 60.0, **programs: str) -> Path:
        """Write a scenario with programs, by their names, and further lines; returns its file."""
        folder = self.folder / f"scenario{next(self._numbers)}"
        folder.mkdir()
        text = f"from taskrpc.simulation import Scenario\n\nscenario = Scenario({duration})\n"
        for name, code in programs.items():
            (folder / f"{name}.py").write_text(textwrap.dedent(code), "utf-8")
            text += f"scenario.program({name!r}, '{name}.py')\n"
        file = folder / "small.sim.py"
        file.write_text(text + textwrap.dedent(more) + _SEEN, "utf-8")
        return file

    def __call__(self, more: str = "", *, duration: float = 60.0, **programs: str) -> Simulated:
        """Write a scenario and load it."""
        file = self.write(more, duration=duration, **programs)
        self.worker.load(file)
        return Simulated(self.worker, file)


@pytest.fixture(scope="session")
def worker():
    """Return the worker process of the whole session: its start takes half a second."""
    with WorkerProcess() as process:
        yield process


@pytest.fixture
def simulated(worker, tmp_path):
    """Return a function that loads a small scenario."""
    return Workbench(worker, tmp_path)
