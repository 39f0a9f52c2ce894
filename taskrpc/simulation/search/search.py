"""Looks for a seed that fails, in several worker processes."""

from __future__ import annotations

import contextlib
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Self, overload

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.run.seeds import Seeds
from taskrpc.simulation.search.protocol import (
    Answer,
    Explain,
    Explained,
    Load,
    Loaded,
    Order,
    Refused,
    Search,
    Searched,
)

_BATCH_SECONDS: Final = 0.25
"""How long one order should keep a worker busy."""
_MOST_IN_BATCH: Final = 200


class WorkerProcess:
    """One worker process.

    `hash_seed`: Python's own order of hashes is random; with a fixed one, sets of texts have the
    same order in each process.
    """

    def __init__(self, hash_seed: str = "0") -> None:
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        for name in list(environment):
            if name.startswith(("TASKRPC_", "ROS_")):
                del environment[name]
        self._process = subprocess.Popen(
            # -P: a file of the working directory, such as queue.py, hides no module of Python.
            [sys.executable, "-P", "-m", "taskrpc.simulation.search.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )
        self._encoder = msgspec.json.Encoder()
        self._decoder = msgspec.json.Decoder(Answer)

    def load(self, file: Path) -> None:
        """Load a scenario. Raises TaskRpcError if it cannot be simulated."""
        self.ask(Load(str(file)))

    @overload
    def ask(self, order: Load) -> Loaded: ...
    @overload
    def ask(self, order: Search) -> Searched: ...
    @overload
    def ask(self, order: Explain) -> Explained: ...
    def ask(self, order: Order) -> Answer:
        """Send an order and return the answer. Raises TaskRpcError if it is refused."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(self._encoder.encode(order) + b"\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = b""
        if not line:
            raise TaskRpcError(
                f"the simulation's process has ended with {self._process.wait()}; its last words"
                " are above"
            )
        answer: Answer = self._decoder.decode(line)
        if isinstance(answer, Refused):
            raise TaskRpcError(answer.problem)
        return answer

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for pipe in self._process.stdin, self._process.stdout:
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):  # it ended before it got all
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()


class Finding(msgspec.Struct, frozen=True):
    """The result of a search."""

    coverage: Coverage
    shapes: int
    """How many runs went another way than all before."""
    seconds: float
    """Real seconds."""
    failure: Explained | None
    hash: str = ""
    """The hash of the run, if there was only one."""


Progress = Callable[[Coverage, int, float], object]
"""Is told what was reached, how many different runs there were, and the real seconds."""


def search(
    file: Path,
    *,
    runs: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    jobs: int | None = None,
    records: bool = False,
    progress: Progress = lambda *_: None,
) -> Finding:
    """Run the scenario of a file with many seeds, up to the first that fails.

    Args:
        file: the scenario's file.
        runs: how many runs.
        seconds: how long, if `runs` is None.
        seed: the first seed.
        jobs: how many worker processes; by default as many as there are cores.
        records: whether the failure has what `recording.write` needs.
        progress: is called several times a second.

    Raises TaskRpcError if the scenario cannot be simulated.
    """
    begin = time.monotonic()
    end = None if seconds is None else begin + seconds
    if runs == 1:
        jobs = 1
    with _Workers(file, jobs or os.cpu_count() or 1) as workers:
        seeds, coverage, failed, last = Seeds(seed, runs), Coverage(), None, ""
        for answer in workers.search(seeds, end):
            coverage.add(answer.coverage)
            seeds.learn(answer.shapes)
            last = answer.hash
            if answer.failed is not None:
                failed = answer.failed if failed is None else min(failed, answer.failed)
                workers.stop()
            progress(coverage, seeds.found, time.monotonic() - begin)
        taken = time.monotonic() - begin
        failure = None if failed is None else workers.first.ask(Explain(failed, records))
        return Finding(coverage, seeds.found, taken, failure, last if runs == 1 else "")


class _Workers:
    """All workers; each has a thread of this process that speaks with it."""

    def __init__(self, file: Path, count: int) -> None:
        self._file = file
        self._count = count
        self.first: WorkerProcess
        self._all: list[WorkerProcess] = []
        self._stopping = False

    def __enter__(self) -> Self:
        self.first = self._new()
        try:
            self.first.load(self._file)
        except BaseException:
            self.first.close()
            raise
        return self

    def _new(self) -> WorkerProcess:
        worker = WorkerProcess()
        self._all.append(worker)
        return worker

    def __exit__(self, *exc_info: object) -> None:
        for each in self._all:
            each.close()

    def stop(self) -> None:
        """Give the workers no more seeds."""
        self._stopping = True

    def search(self, seeds: Seeds, end: float | None) -> Iterator[Searched]:
        """Yield the answers of all workers, until the seeds or the time are used up."""
        answers: queue.Queue[Searched | BaseException | None] = queue.Queue()
        guard = threading.Lock()

        def work(worker: WorkerProcess | None) -> None:
            try:
                if worker is None:
                    worker = self._new()
                    worker.load(self._file)
                size = 1
                while not self._stopping and (end is None or time.monotonic() < end):
                    with guard:
                        batch = seeds.take(size)
                    if not batch:
                        break
                    begin = time.monotonic()
                    answers.put(worker.ask(Search(batch)))
                    taken = (time.monotonic() - begin) / len(batch)
                    size = max(1, min(_MOST_IN_BATCH, int(_BATCH_SECONDS / max(taken, 1e-4))))
            except BaseException as error:
                answers.put(error)
            finally:
                answers.put(None)

        threads = [
            threading.Thread(target=work, args=(self.first if index == 0 else None,), daemon=True)
            for index in range(self._count)
        ]
        for thread in threads:
            thread.start()
        left = len(threads)
        while left:
            answer = answers.get()
            if answer is None:
                left -= 1
            elif isinstance(answer, BaseException):
                raise answer
            else:
                yield answer
