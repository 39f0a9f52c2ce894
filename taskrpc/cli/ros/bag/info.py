"""`taskrpc bag info` and `taskrpc bag sequence`: what a recording contains."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence

import msgspec

from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import Exit, NotFound
from taskrpc.observe.recording.mcap_file import Topic
from taskrpc.observe.recording.schemas import EVENT, is_event
from taskrpc.observe.recording.sqlite_file import AnyRecording, open_recording
from taskrpc.observe.texts import printable
from taskrpc.spi import SUFFIX


class Contents(msgspec.Struct):
    """The contents of a recording, counted."""

    counts: dict[Topic, int]
    """The messages of each topic."""
    begin: int = 0
    """The time of the first message, in nanoseconds since 1970; 0 without messages."""
    end: int = 0

    @property
    def topics(self) -> list[tuple[Topic, int]]:
        """The topics that are no events of services, by name."""
        return self._selected(events=False)

    @property
    def services(self) -> list[tuple[Topic, int]]:
        """The event topics of services, by name."""
        return self._selected(events=True)

    def _selected(self, *, events: bool) -> list[tuple[Topic, int]]:
        found = [each for each in self.counts.items() if is_event(each[0].type_name) is events]
        return sorted(found, key=lambda each: each[0].name)


def contents(recording: AnyRecording) -> Contents:
    """Read a whole recording and count its messages."""
    found = Contents({})
    counts: dict[Topic, int] = found.counts
    for message in recording.messages():
        counts[message.topic] = counts.get(message.topic, 0) + 1
        found.begin = min(found.begin or message.time, message.time)
        found.end = max(found.end, message.time)
    for topic in recording.topics.values():
        counts.setdefault(topic, 0)
    return found


def info(options: argparse.Namespace) -> Exit:
    """Print what a recording contains."""
    recording = open_recording(options.file)
    found = contents(recording)
    if options.topic_name:
        print("\n".join(printable(topic.name) for topic, _ in found.topics))
    elif options.json:
        print(json.dumps(_as_json(recording, found)))
    else:
        print("\n".join(_lines(recording, found)))
    if recording.problem:
        print(f"WARNING: {recording.problem}", file=sys.stderr)
    return Exit.DONE


def _lines(recording: AnyRecording, found: Contents) -> Iterator[str]:
    yield ""
    yield f"Files:             {recording.path.name}"
    yield f"Bag size:          {_size(recording.size)}"
    yield f"Storage id:        {recording.storage_id}"
    yield f"Duration:          {(found.end - found.begin) / 1e9:.9f}s"
    yield f"Start:             {_instant(found.begin)}"
    yield f"End:               {_instant(found.end)}"
    yield f"Messages:          {sum(found.counts.values())}"
    yield from _listed("Topic information: ", [_topic_line(*each) for each in found.topics])
    yield f"Services:          {len(found.services)}"
    yield from _listed("Service information: ", [_service_line(*each) for each in found.services])
    yield ""


def _listed(title: str, lines: Sequence[str]) -> Iterator[str]:
    for number, line in enumerate(lines or [""]):
        yield (" " * len(title) if number else title) + line


def _topic_line(topic: Topic, count: int) -> str:
    kind = topic.type_name or "(no schema)"
    shown = f"Topic: {topic.name} | Type: {kind} | Count: {count}"
    return printable(f"{shown} | Serialization Format: {topic.encoding}")


def _service_line(topic: Topic, count: int) -> str:
    name, kind = topic.name.removesuffix(SUFFIX), topic.type_name.removesuffix(EVENT)
    shown = f"Service: {name} | Type: {kind} | Event Count: {count}"
    return printable(f"{shown} | Serialization Format: {topic.encoding}")


def _size(number: float) -> str:
    for unit in ("B", "KiB", "MiB"):
        if number < 1024:
            return f"{number:.4g} {unit}"
        number /= 1024
    return f"{number:.4g} GiB"


def _instant(nanoseconds: int) -> str:
    seconds, fraction = divmod(nanoseconds, 10**9)
    day = time.strftime("%b %d %Y %H:%M:%S", time.localtime(seconds))
    return f"{day}.{fraction:09d} ({seconds}.{fraction:09d})"


def _as_json(recording: AnyRecording, found: Contents) -> dict[str, object]:
    return {
        "file": str(recording.path),
        "size": recording.size,
        "begin": found.begin / 1e9,
        "end": found.end / 1e9,
        "messages": sum(found.counts.values()),
        "topics": [
            {"name": topic.name, "type": topic.type_name, "count": count}
            for topic, count in found.topics
        ],
        "services": [
            {
                "name": topic.name.removesuffix(SUFFIX),
                "type": topic.type_name.removesuffix(EVENT),
                "events": count,
            }
            for topic, count in found.services
        ],
        "problem": recording.problem,
    }


def sequence(options: argparse.Namespace) -> Exit:
    """Print a Mermaid sequence diagram of the recorded calls."""
    from taskrpc.observe.recording.sequence import diagram

    recording = open_recording(options.file)
    services = [quoting.expanded(name) for name in options.services]
    text = diagram(recording, limit=options.limit, services=services)
    if not text:
        named = f" of {', '.join(services)}" if services else ""
        raise NotFound(f"{options.file} has no calls{named}; taskrpc bag info lists its services")
    print(text, end="", flush=True)
    if recording.problem:
        print(f"WARNING: {recording.problem}", file=sys.stderr)
    return Exit.DONE
