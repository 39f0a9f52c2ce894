"""What the command and its worker processes say to each other: one JSON line each."""

from __future__ import annotations

import msgspec

from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.run.trace import Event


class Load(msgspec.Struct, tag=True):
    """Load a scenario's file; answered by `Loaded` or `Refused`."""

    file: str


class Search(msgspec.Struct, tag=True):
    """Run seeds, one after another, up to the first that fails; answered by `Searched`."""

    seeds: list[int]


class Explain(msgspec.Struct, tag=True):
    """Find the fewest faults of a failing seed, and tell the story; answered by `Explained`."""

    seed: int


Order = Load | Search | Explain


class Loaded(msgspec.Struct, tag=True):
    """The scenario can run."""

    programs: list[str]


class Refused(msgspec.Struct, tag=True):
    """The user must change something first."""

    problem: str


class Searched(msgspec.Struct, tag=True):
    """The runs of some seeds."""

    coverage: Coverage
    shapes: list[tuple[int, int]]
    """For each run, the seed and the hash of what happened in which order."""
    failed: int | None
    """The seed of the run that failed."""
    hash: str
    """The hash of the last run: runs with the same hash went the same way."""
    cpu_seconds: float
    """How long the processor worked."""


class Explained(msgspec.Struct, tag=True):
    """A failing run with as few faults as possible."""

    seed: int
    kind: str
    text: str
    faults: list[str]
    groups: list[str]
    """Which of `shrink.GROUPS` the failure needs."""
    in_order: bool
    """Whether it fails also when the threads run in order."""
    hash: str
    events: list[Event]
    waits: list[str]
    """What the programs that have not ended wait for, one line each."""
    first_faults: int
    """How many faults the run had before."""


Answer = Loaded | Refused | Searched | Explained
