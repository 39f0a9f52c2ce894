"""A process that simulates one run of a submission's program, and reports to the checks."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from taskrpc.course.labs.sandbox.child import Start, environment
from taskrpc.course.labs.sandbox.limits import CONFINED, LIMITS, limit_this_process
from taskrpc.course.labs.sandbox.simulated.messages import (
    Asked,
    Ended,
    Plan,
    Printed,
    Reply,
    Told,
)

_CHECKS = "checks"
"""The name of `companion` in the run."""

plan: Plan
"""What `companion` does."""
link: Link
"""How it talks to the checks."""


class Link:
    """The streams to and from the checks; an answer takes no virtual time.

    `now` returns the virtual seconds since the begin of the run.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self.now = now
        self._output, self._input = os.dup(1), os.fdopen(os.dup(0), "rb", 0)
        os.dup2(2, 1)  # what anything else writes is no message
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)

    def tell(self, message: Told) -> None:
        """Send a message."""
        data = msgspec.json.encode(message) + b"\n"
        while data:
            data = data[os.write(self._output, data) :]

    def ask(self, request: Asked) -> Reply:
        """Send a request, and wait for its reply."""
        self.tell(request)
        return msgspec.json.decode(self._input.readline(), type=Reply)


def main(text: str) -> int:
    """Simulate the program of a `Start`."""
    global plan, link
    start = msgspec.json.decode(text, type=Start)
    assert start.plan is not None
    os.environ.clear()
    os.environ.update(environment(Path(start.scratch)))
    os.chdir(start.folder)
    limit_this_process(CONFINED if start.confined else LIMITS)
    if start.ready:
        Path(start.ready).touch()

    from taskrpc.simulation.search.worker import Worker

    worker = Worker()  # replaces threads and clocks before the import of anything that uses them
    from taskrpc.simulation import Scenario
    from taskrpc.simulation.interpreter.refusals import CannotSimulate

    scenario = Scenario(start.plan.duration)
    scenario.program(_CHECKS, Path(__file__).with_name("companion.py"))
    name = Path(start.file).stem
    scenario.program(name, start.file, *start.arguments)
    plan, link = start.plan, Link(lambda: run.now)
    worker.use(scenario, Path(start.folder))
    run = worker.new_run(0, (), orderly=True)
    run.play()
    [program] = (each for each in run.lives if each.name == name)
    events = run.trace.events
    times = [each.time for each in events if (each.program, each.kind) == (name, "print")]
    lines = [Printed(*each) for each in zip(times, program.lines, strict=False)]
    lines += [Printed(run.now, text) for text in program.lines[len(lines) :]]  # a traceback
    problem = refused = ""
    if run.failure is not None:
        if run.failure.kind == CannotSimulate.__name__:
            refused = run.failure.text
        else:
            problem = f"{run.failure.kind}: {run.failure.text}"
    link.tell(Ended(program.exit_code, lines, problem, refused))
    sys.stderr.flush()
    os._exit(0)  # the threads of the programs are none that Python could wait for
