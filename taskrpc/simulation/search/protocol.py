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
    records: bool = False
    """Whether the answer has the contents of the calls."""


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


class ServiceType(msgspec.Struct, frozen=True):
    """The type of a service's events, as recordings describe it."""

    name: str
    """Such as `std_srvs/srv/Trigger_Event`."""
    schema: str
    hash: str


class ToldCall(msgspec.Struct, frozen=True):
    """A call of a recorded run; its times are virtual seconds."""

    number: int
    client: str
    service: str
    began: float
    ended: float | None
    code: str
    """The name of its error code; `OK` for a response, and while it has not ended."""
    deadline: float | None


class ServiceEvent(msgspec.Struct, frozen=True):
    """A step of a call, as ROS records it."""

    time: float
    service: str
    call: int
    data: bytes
    """CDR."""


class Contents(msgspec.Struct, frozen=True):
    """The calls of a run, for its recording."""

    calls: list[ToldCall]
    types: dict[str, ServiceType]
    """By the name of the service; without those whose definition is missing."""
    events: list[ServiceEvent]
    """In the order of time."""


class Explained(msgspec.Struct, tag=True, omit_defaults=True):
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
    failed_at: float
    """Virtual seconds."""
    contents: Contents | None = None
    """The calls, if the order asked for them."""


Answer = Loaded | Refused | Searched | Explained
