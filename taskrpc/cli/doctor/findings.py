"""What a check of `taskrpc doctor` says: fine, worth knowing, or a problem and what to do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the doctor's report."""

    state: str
    """`ok`, `note` or `problem`."""
    text: str
    advice: str = ""
    """What to do, where something is to be done."""


def ok(text: str) -> Finding:
    """All is well with this."""
    return Finding("ok", text)


def note(text: str, advice: str = "") -> Finding:
    """Nothing is wrong, but it may explain something."""
    return Finding("note", text, advice)


def problem(text: str, advice: str) -> Finding:
    """This will not work until something is done."""
    return Finding("problem", text, advice)
