"""Tells a failing run so that a student understands it: one line an event."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.run.trace import Event
from taskrpc.simulation.search.fault_words import fault_words
from taskrpc.simulation.search.protocol import Explained

_WORDS: Final = {
    "start": "{text}",
    "print": "prints: {text}",
    "call": "calls {text}",
    "answer": "gets the response of {text}",
    "error": "call fails: {text}",
    "begin": "begins {text}",
    "cancel": "cancels {text}, since the caller no longer waits",
    "message": "publishes on {text}",
    "fault": "FAULT: {text}",
    "crash": "FAULT: {text}",
    "end": "{text}",
    "raise": "ends with {text}",
}
_MOST_NAMES = 5
_GROUP_WORDS: Final = {
    "delays": "these delays of the network",
    "order of starts": "this order of the starts",
}
_LONGEST = 40
"""Events that are shown at most: the first, the last, those around the faults and the failure."""
_IMPORTANT: Final = ("fault", "crash", "raise")


def story(found: Explained, lines: Mapping[str, Sequence[str]], *, everything: bool = False) -> str:
    """Return the failure and how it came about.

    `lines`: the lines of the programs' files, by name, which are shown beside the events. Without
    `everything`, a long story has gaps.
    """
    return "\n".join(
        [
            f"FAILED: {found.kind}",
            *(f"  {line}" for line in found.text.rstrip().splitlines()),
            "",
            _needs(found),
            "",
            *_events(found, lines, everything),
            *_waits(found.waits),
        ]
    )


def _needs(found: Explained) -> str:
    names = [fault_words(each) for each in found.faults]
    names += [_GROUP_WORDS[each] for each in found.groups]
    if not found.in_order:
        names.append("an unlucky order of the threads")
    what = " and ".join(names) or "no fault at all"
    return f"Seed {found.seed} fails with {what}."


def _events(found: Explained, lines: Mapping[str, Sequence[str]], everything: bool) -> list[str]:
    width = max((len(each.program) for each in found.events), default=0)
    if everything:
        folded = [(each, 1) for each in found.events]
        shown: Sequence[int] = range(len(folded))
    else:
        folded = _folded(found.events)
        shown = _around_what_matters([each for each, _ in folded], found.failed_at)
    told, before = [], -1
    for index in shown:
        if left_out := sum(count for _, count in folded[before + 1 : index]):
            told.append(f"{'':8}    … {left_out} more events (--verbose shows them)")
        before, (each, count) = index, folded[index]
        text = fault_words(each.text) if each.kind == "fault" else each.text
        words = _WORDS[each.kind].format(text=text)
        if count > 1:
            words += f", {count} times until the next other event"
        told.append(f"{each.time:8.3f} s  {each.program:<{width}}  {words}{_source(each, lines)}")
    return told


def _folded(events: Sequence[Event]) -> list[tuple[Event, int]]:
    """Return the events, each with a count; equal messages between two other events are one."""
    folded: list[tuple[Event, int]] = []
    places: dict[tuple[str, str, str], int] = {}
    for each in events:
        key = each.program, each.text, each.where
        if each.kind != "message":
            places.clear()
        elif (place := places.get(key)) is not None:
            first, count = folded[place]
            folded[place] = first, count + 1
            continue
        else:
            places[key] = len(folded)
        folded.append((each, 1))
    return folded


def _around_what_matters(events: Sequence[Event], failed_at: float) -> list[int]:
    """Return the indexes of the events to show: those nearest to the faults and the failure."""
    if len(events) <= _LONGEST:
        return list(range(len(events)))
    failed = sum(each.time <= failed_at for each in events) - 1
    ends = [0, max(failed, 0), len(events) - 1]
    faults = [index for index, each in enumerate(events) if each.kind in _IMPORTANT]
    centres = [*ends, *faults[: _LONGEST - len(ends)]]

    def distance(index: int) -> int:
        return min(abs(index - each) for each in centres)

    return sorted(sorted(range(len(events)), key=distance)[:_LONGEST])


def _source(event: Event, lines: Mapping[str, Sequence[str]]) -> str:
    file, _, number = event.where.partition(":")
    if not number:
        return ""
    code = lines.get(file, ())
    text = code[int(number) - 1].strip() if int(number) <= len(code) else ""
    return f"    {event.where}  {text}"


def _waits(waits: Sequence[str]) -> list[str]:
    return ["", "At the end:", *(f"  {line}" for line in waits)] if waits else []


def lines_of(found: Explained, folder: Path) -> dict[str, list[str]]:
    """Return the lines of the files that the events name; looks for them in a folder."""
    read = {}
    for name in dict.fromkeys(each.where.partition(":")[0] for each in found.events if each.where):
        for path in folder.rglob(name):
            read[name] = path.read_text(encoding="utf-8", errors="replace").splitlines()
            break
    return read


def summary(coverage: Coverage, shapes: int, seconds: float) -> str:
    """Return what all runs have reached, and what they have not."""
    each = coverage.runs / seconds if seconds else 0.0
    lines = [
        f"{coverage.runs} runs in {seconds:.1f} s ({each:.0f} a second; {coverage.seconds:.0f} s of"
        f" virtual time), {shapes} different courses."
    ]
    if coverage.calls:
        calls = _counts(coverage.calls, coverage.unanswered, "without a response")
        lines.append(f"Calls: {calls}.")
    if coverage.messages:
        messages = _counts(coverage.messages, coverage.unheard, "without a subscription")
        lines.append(f"Messages: {messages}.")
    if coverage.faults:
        faults = ", ".join(f"{name} {count}" for name, count in sorted(coverage.faults.items()))
        lines.append(f"Faults: {faults}.")
    never = sorted(coverage.offered.keys() - coverage.calls.keys())
    if never:
        more = f" and {len(never) - _MOST_NAMES} more" if len(never) > _MOST_NAMES else ""
        lines.append(f"Not reached: nobody called {', '.join(never[:_MOST_NAMES])}{more}.")
    return "\n".join(lines)


def _counts(counts: Mapping[str, int], some: Mapping[str, int], which: str) -> str:
    return ", ".join(
        f"{name} {count}" + (f" ({some[name]} {which})" if some.get(name) else "")
        for name, count in sorted(counts.items())
    )
