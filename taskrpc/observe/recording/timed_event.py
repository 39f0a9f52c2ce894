"""Events of the live page with their times, and the notes that become such events.

A recorded simulation has notes: what its programs printed, the faults, and how it failed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import msgspec

NOTES_TOPIC: Final = "/taskrpc/simulation"
"""The topic with a `Note` for each event of a simulation, as JSON."""
MOST_PRINTS: Final = 25_000
"""Most printed lines that the page gets; of more, every n-th is shown."""

_TONES: Final = {"fault": "violet", "crash": "violet", "raise": "bad", "failure": "bad"}
"""The tones of the notes that the page marks."""
_SHOWN: Final = {"start", "print", "end", *_TONES}
"""The kinds of notes that the page shows. The other kinds are about calls, which a recording has in
topics of their own."""
_AGAIN: Final = "starts again"


class TimedEvent(msgspec.Struct, frozen=True):
    """An event of the live page, with its time."""

    t: float
    """Seconds since 1970."""
    event: str
    """Its name, such as `tasks`."""
    data: dict[str, Any]


class Note(msgspec.Struct, frozen=True, omit_defaults=True):
    """Something that happened in a simulated run."""

    time: float
    """Seconds since the begin of the run."""
    program: str
    kind: str
    """`print`, `fault`, `failure`, or another kind of event of `taskrpc simulate`."""
    text: str
    where: str = ""
    """The file and line of the program, such as `client.py:12`; "" where it is not known."""


def note_events(notes: Sequence[tuple[float, Note]]) -> Iterator[TimedEvent]:
    """Yield the notes that the page shows; `notes` have their times in seconds since 1970.

    A note with a `tone` gets a mark.
    """
    prints = sum(note.kind == "print" for _, note in notes)
    stride = max(1, math.ceil(prints / MOST_PRINTS))
    count = 0
    for time, note in sorted(notes, key=lambda each: each[0]):
        if note.kind not in _SHOWN:
            continue
        if note.kind == "print":
            count += 1
            if count % stride:
                continue
        tone = "quiet" if note.text == _AGAIN else _TONES.get(note.kind, "")
        data = {"program": note.program, "kind": note.kind, "text": note.text, "where": note.where}
        yield TimedEvent(time, "note", {**data, "tone": tone})
