"""What the page shows of each lab: its text, its files, and how its programs are started."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

import msgspec

from taskrpc.course.labs.catalogue import LABS
from taskrpc.course.labs.lab import Lab
from taskrpc.course.labs.starter import filled, starter_files
from taskrpc.course.labs.variants import Variant

LAST_LAB = 3
"""The labs after this one need several processes, or faults of a real network."""


class Sheet(msgspec.Struct, frozen=True):
    """What the page adds to a lab."""

    steps: Sequence[str]
    """What the student does, in order; words in backquotes are code."""
    arguments: Mapping[str, str] = {}
    """The arguments with which the page starts programs, by file."""


_SHEETS = {
    1: Sheet(
        steps=(
            "Read `server.py`. Predict: what happens if you run it as it is?",
            "Press Run, and compare. The lines of both programs appear below, each with the"
            " name of its program.",
            "Fill in the numbered steps in `server.py`. Run it: now the server runs until you stop"
            " it.",
            "Fill in the numbered steps in `client.py`. The numbers in the field beside"
            " `client.py` are its arguments.",
            "Explain to your neighbour: who waits for whom, and which line lets the callback run?",
            "Press Check.",
        ),
        arguments={"client.py": "2 3"},
    ),
    2: Sheet(
        steps=(
            "Read the `.srv` file and `server.py`. Predict: what is the type of each field?",
            "Write the definition: the steps 1 to 8 in the `.srv` file. Press Check: its first two"
            " checks need no server.",
            "Fill in the steps in `server.py`, and press Run.",
            "Explain to your neighbour: which wrong values does the type refuse, and which ones"
            " only your callback?",
            "Press Check.",
        ),
    ),
    3: Sheet(
        steps=(
            "Read `slow_server.py`. Predict: how long do three calls take, one after another, and"
            " all at the same time?",
            "Fill in the steps in `sync_client.py`. Start `slow_server.py`, then this client with"
            " its own button, and compare.",
            "Fill in the steps in `async_client.py`, start it, and compare: when does the timer"
            " tick?",
            "Explain to your neighbour: which line of each client waits, and what runs meanwhile?",
            "Press Check.",
        ),
    ),
}

_PLAIN = Sheet(
    steps=(
        "Read the files. Predict: what happens if you run them as they are?",
        "Press Run, and compare.",
        "Follow the numbered comments in the files.",
        "Explain to your neighbour what each line is for. Then press Check.",
    )
)


def exercises(variant: str = "") -> list[dict[str, Any]]:
    """Return what the page needs to know of each lab, as values of JSON."""
    return [_exercise(lab, variant) for lab in LABS if lab.number <= LAST_LAB]


def _exercise(lab: Lab, variant: str) -> dict[str, Any]:
    sheet = _SHEETS.get(lab.number, _PLAIN)
    return {
        "number": lab.number,
        "title": lab.title,
        "minutes": lab.minutes,
        "goal": lab.goal,
        "steps": sheet.steps,
        "variant": variant,
        "files": _files(starter_files(lab, Variant(variant)), sheet),
        "async_files": _files(_async_files(lab, Variant(variant)), sheet),
    }


def _async_files(lab: Lab, variant: Variant) -> dict[str, str]:
    """Return the asynchronous programs of a lab, with its other files; none if it has none."""
    folder = resources.files("taskrpc.course.browser_lab") / "async_files" / f"lab{lab.number}"
    values = lab.values(variant)
    texts = {}
    for name, text in starter_files(lab, variant).items():
        program = folder / name
        if program.is_file():
            texts[name] = filled(program.read_text(encoding="utf-8"), values)
        elif not name.endswith(".py"):
            texts[name] = text
    return texts if any(name.endswith(".py") for name in texts) else {}


def _files(texts: Mapping[str, str], sheet: Sheet) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "text": text,
            "program": name.endswith(".py"),
            "arguments": sheet.arguments.get(name, ""),
        }
        for name, text in texts.items()
    ]
