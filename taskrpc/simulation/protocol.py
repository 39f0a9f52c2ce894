"""What the command and its worker processes say to each other: one JSON line each."""

from __future__ import annotations

import msgspec

from taskrpc.simulation.trace import Event


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


class Coverage(msgspec.Struct):
    """What runs have reached."""

    runs: int = 0
    seconds: float = 0.0
    """Virtual seconds."""
    calls: dict[str, int] = {}
    """By service."""
    unanswered: dict[str, int] = {}
    """Calls that ended with an error or never, by service."""
    offered: dict[str, int] = {}
    """In how many runs a service was offered."""
    faults: dict[str, int] = {}
    """How often each kind of fault happened."""

    def add(self, other: Coverage) -> None:
        """Add what other runs have reached."""
        self.runs += other.runs
        self.seconds += other.seconds
        for name in "calls", "unanswered", "offered", "faults":
            mine = getattr(self, name)
            for key, count in getattr(other, name).items():
                mine[key] = mine.get(key, 0) + count


class Searched(msgspec.Struct, tag=True):
    """The runs of some seeds."""

    coverage: Coverage
    shapes: list[tuple[int, int]]
    """For each run, the seed and the hash of what happened in which order."""
    failed: int | None
    """The seed of the run that failed."""


class Explained(msgspec.Struct, tag=True):
    """A failing run with as few faults as possible."""

    seed: int
    kind: str
    text: str
    faults: list[str]
    in_order: bool
    """Whether it fails also when the threads run in order."""
    hash: str
    events: list[Event]
    waits: list[str]
    """What the programs that have not ended wait for, one line each."""
    first_faults: int
    """How many faults the run had before."""


Answer = Loaded | Refused | Searched | Explained
