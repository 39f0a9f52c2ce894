"""Writes a failing run as a recording, which `taskrpc view` plays and tools of ROS read."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from taskrpc.observe.recording.calls import CALLS_TOPIC, CallEnd
from taskrpc.observe.recording.mcap_file import RecordingError, RecordingWriter
from taskrpc.observe.recording.timed_event import NOTES_TOPIC, Note
from taskrpc.simulation.interpreter.loop import FIRST_DAY
from taskrpc.simulation.search.fault_words import fault_words
from taskrpc.simulation.search.protocol import Contents, Explained
from taskrpc.spi import SUFFIX

_NS: Final = 10**9


def check_path(path: Path) -> None:
    """Raise RecordingError if no recording can be created at a path; creates nothing.

    The file is created after the search: the simulated programs see the files of their folder.
    """
    if path.exists():
        problem = "the file exists already; choose another name or remove it"
    elif not path.absolute().parent.is_dir():
        problem = f"there is no folder {path.parent}"
    elif not os.access(path.absolute().parent, os.W_OK):
        problem = f"you may not write in the folder {path.absolute().parent}"
    else:
        return
    raise RecordingError(f"cannot record to {path}: {problem}")


def write(path: Path, found: Explained) -> None:
    """Write a failing run into a new file. Raises RecordingError."""
    assert found.contents is not None, "the search was told to record"
    writer = RecordingWriter(path)
    try:
        _write(writer, found, found.contents)
        writer.close()
    except BaseException:
        writer.discard()
        raise


def _write(writer: RecordingWriter, found: Explained, contents: Contents) -> None:
    topics = {
        service: writer.add_topic(service + SUFFIX, each.name, each.schema, type_hash=each.hash)
        for service, each in contents.types.items()
    }
    notes, ends = writer.add_json_topic(NOTES_TOPIC), writer.add_json_topic(CALLS_TOPIC)
    encode = msgspec.json.Encoder().encode
    messages = [
        *((each.time, topics[each.service], each.data) for each in contents.events),
        *((each.time, notes, encode(each)) for each in _notes(found)),
        *((time, ends, encode(end)) for time, end in _ends(contents, found.failed_at)),
    ]
    for time, topic, data in sorted(messages, key=lambda message: message[0]):
        writer.write(topic, data, int(FIRST_DAY) * _NS + round(time * _NS))


def _notes(found: Explained) -> Iterator[Note]:
    for each in found.events:
        text = fault_words(each.text) if each.kind == "fault" else each.text
        yield Note(each.time, each.program, each.kind, text, each.where)
    lines = found.text.strip().splitlines() or [""]
    text = lines[-1 if lines[0].startswith("Traceback") else 0]  # a traceback ends with the error
    yield Note(found.failed_at, "", "failure", f"{found.kind}: {text}" if text else found.kind)


def _ends(contents: Contents, end: float) -> Iterator[tuple[float, CallEnd]]:
    """Yield the end of each call, with the time of its last event.

    A service may respond after its caller has stopped waiting; readers expect a call's end last.
    """
    last = {each.call: each.time for each in contents.events}
    for call in contents.calls:
        ms = None if call.ended is None else (call.ended - call.began) * 1e3
        limit = None if call.deadline is None else (call.deadline - call.began) * 1e3
        yield (
            max(end if call.ended is None else call.ended, last.get(call.number, 0.0)),
            CallEnd(
                call.number,
                call.service,
                call.client,
                FIRST_DAY + call.began,
                ms,
                call.code,
                deadline_ms=limit,
            ),
        )
