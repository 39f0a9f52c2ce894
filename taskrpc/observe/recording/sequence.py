"""A Mermaid sequence diagram of the calls of a recording, for a lab report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from taskrpc.observe.recording.calls import CallReader, RecordedCall, is_about_calls
from taskrpc.observe.recording.decisions import DECISIONS_TOPIC, TaskChange, decision_of
from taskrpc.observe.recording.sqlite_file import AnyRecording
from taskrpc.robot.tasks.model import TaskState

_ROBOT = "the robot"  # no node can have this name
_UNSAFE = {"#": "#35;", ";": "#59;", "<": "#lt;", ">": "#gt;", "%": "#37;", "$": "#36;"}
"""Characters with a meaning in Mermaid or HTML, and their spelling in a text.

`%%{` begins a directive, which changes the whole diagram; `$$` begins a formula.
"""
_LONGEST = 200
"""Characters of one text."""


class Arrow(msgspec.Struct, frozen=True):
    """One arrow of the diagram."""

    time: float
    """Seconds since 1970."""
    start: str
    """The participant where it begins."""
    end: str
    kind: str
    """`->>` a request, `-->>` a response, `--x` an error."""
    text: str


def diagram(recording: AnyRecording, *, limit: int = 100, services: Sequence[str] = ()) -> str:
    """Return the diagram as text; "" if the recording has no call.

    Args:
        recording: the file.
        limit: draw at most this many calls, the first ones.
        services: draw the calls of these services only; empty for all.
    """
    reader, changes = CallReader(), []
    for message in recording.messages():
        if message.topic.name == DECISIONS_TOPIC:
            decision = decision_of(message)
            if isinstance(decision, TaskChange):
                changes.append((message.time / 1e9, decision))
        elif is_about_calls(message.topic):
            reader.take(message)
    calls = [call for call in reader.calls if not services or call.service in services]
    calls.sort(key=lambda call: call.begin)
    if not calls:
        return ""
    more, calls = len(calls) - limit, calls[:limit]
    groups = _groups({call.service for call in calls})
    arrows = [arrow for call in calls for arrow in _arrows_of_call(call, groups)]
    main = _server_of_tasks(groups)
    if main and not services:
        until = calls[-1].begin if more > 0 else float("inf")
        arrows += _arrows_of_tasks(changes, main, until)
    return "\n".join([*_text(sorted(arrows, key=lambda arrow: arrow.time), more), ""])


def _groups(services: set[str]) -> dict[str, str]:
    """Return the participant of each service; `/robot_task/list` belongs to `/robot_task`."""
    found: dict[str, str] = {}
    for service in sorted(services):
        owner = next((each for each in found if service.startswith(f"{each}/")), service)
        found[service] = found.get(owner, owner)
    return found


def _server_of_tasks(groups: dict[str, str]) -> str:
    return next((each for each in groups.values() if each.endswith("/robot_task")), "")


def _arrows_of_call(call: RecordedCall, groups: dict[str, str]) -> Iterator[Arrow]:
    server = groups[call.service]
    verb = call.service.removeprefix(server).lstrip("/")
    request = " ".join(part for part in (verb, call.request) if part) or "request"
    yield Arrow(call.begin, call.client, server, "->>", request)
    if call.ms is None and not call.code:
        return
    took = "" if call.ms is None else f" ({call.ms:.3g} ms)"
    end = call.begin + (call.ms or 0.0) / 1e3
    kind, text = ("--x", call.code) if call.code else ("-->>", call.response or "response")
    yield Arrow(end, server, call.client, kind, text + took)


def _arrows_of_tasks(
    changes: Sequence[tuple[float, TaskChange]], server: str, until: float
) -> Iterator[Arrow]:
    known: dict[int, TaskState] = {}
    for time, change in changes:
        task, before = change.task, known.get(change.task.task_id)
        known[task.task_id] = task.state
        if time > until or task.state is before:
            continue
        if task.state is TaskState.RUNNING and before is not TaskState.PAUSED:
            text = f"task {task.task_id}: {task.task_type} {task.target}"
            yield Arrow(task.started_at or time, server, _ROBOT, "->>", text)
        elif task.state.is_ended and task.started_at is not None:
            text = f"task {task.task_id} {task.state.value}"
            yield Arrow(task.ended_at or time, _ROBOT, server, "-->>", text)


def _text(arrows: Sequence[Arrow], more: int) -> Iterator[str]:
    yield "sequenceDiagram"
    aliases = _participants(arrows)
    for name, alias in aliases.items():
        yield f"    participant {alias} as {_safe(name)}"
    begin = arrows[0].time
    for arrow in arrows:
        start, end = aliases[arrow.start], aliases[arrow.end]
        label = f"{arrow.time - begin:.3f} s  {arrow.text}"
        yield f"    {start}{arrow.kind}{end}: {_safe(label)}"
    if more > 0:
        last = list(aliases.values())
        yield f"    Note over {last[0]},{last[-1]}: {more} more calls are not shown"


def _participants(arrows: Sequence[Arrow]) -> dict[str, str]:
    """Return a short name for each participant: clients, then servers, then the robot."""
    clients = dict.fromkeys(arrow.start for arrow in arrows if _is_request(arrow))
    servers = dict.fromkeys(arrow.end for arrow in arrows if _is_request(arrow))
    robot = [_ROBOT] if any(_ROBOT in (arrow.start, arrow.end) for arrow in arrows) else []
    names = dict.fromkeys([*clients, *servers, *robot])
    return {name: f"p{number}" for number, name in enumerate(names, 1)}


def _is_request(arrow: Arrow) -> bool:
    return arrow.kind == "->>" and arrow.end != _ROBOT


def _safe(text: str) -> str:
    if len(text) > _LONGEST:
        text = text[: _LONGEST - 1] + "…"
    clean = (letter if letter.isprintable() else " " for letter in text)
    return "".join(_UNSAFE.get(letter, letter) for letter in clean)
