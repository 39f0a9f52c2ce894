"""The picture of `view()` as HTML and as text: the map, the robot, the queue and the last calls."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from html import escape

import msgspec

from taskrpc.course.notebook.calls import EndedCall
from taskrpc.observe.top.model import Pose, TaskRow, TaskServerRow
from taskrpc.robot.kinematics import Point
from taskrpc.robot.world import World

_WIDTH = 380  # pixels of the map
_MOST_TASKS = 10  # shown of the queue
_TEXT = "var(--jp-content-font-color1, var(--vscode-editor-foreground, currentColor))"
_FONT = "var(--jp-content-font-family, system-ui, sans-serif)"
_ROBOT, _TARGET, _ERROR = "#1a73e8", "#c2410c", "#d84315"  # readable on light and dark pages
_CELL = "padding:2px 12px 2px 0;text-align:left;background:none"
_RIGHT = "padding:2px 12px 2px 0;text-align:right;background:none;font-variant-numeric:tabular-nums"


class Shown(msgspec.Struct, frozen=True):
    """What a picture shows."""

    world: World
    """The map of the robot."""
    server: TaskServerRow | None = None
    """The task server; None if there is none."""
    trail: tuple[Point, ...] = ()
    """Where the robot has been."""
    calls: tuple[EndedCall, ...] = ()
    """The newest calls, the newest first."""


def html(shown: Shown) -> str:
    """Return the picture as HTML that needs no other file."""
    parts = [_status(shown.server)]
    if shown.server is not None:
        parts.append(_queue(shown.server))
    if shown.calls:
        parts.append(_calls(shown.calls))
    drawing = "" if shown.server is None else _map(shown.world, shown.server, shown.trail)
    style = f"display:flex;flex-wrap:wrap;gap:16px 28px;align-items:flex-start;color:{_TEXT};"
    return (
        f'<div style="{style}font:13px/1.45 {_FONT}">{drawing}'
        f'<div style="min-width:260px">{"".join(parts)}</div></div>'
    )


def text(shown: Shown) -> str:
    """Return the picture as lines of text."""
    lines = [_state(shown.server)]
    if shown.server is not None:
        if (pose := shown.server.pose) is not None:
            lines.append(f"robot at {pose.x:.2f},{pose.y:.2f}")
        lines += [
            f"  {row.task_id:>4}  {row.work:<22} priority {row.priority:<2}  {_progress(row)}"
            for row in shown.server.tasks[:_MOST_TASKS]
        ]
    if shown.calls:
        lines.append("last calls:")
        lines += [
            f"  {_clock(call.at)}  {_caller(call)} -> {call.service}  {call.result}  {call.ms:g} ms"
            for call in shown.calls
        ]
    return "\n".join(lines)


def _state(server: TaskServerRow | None) -> str:
    if server is None:
        return "no task server is running"
    if server.problem:
        return f"{server.service}: {server.problem}"
    count = "no task waits" if not server.queued else f"{server.queued} in the queue"
    return f"{server.service}: {server.state}, {count}"


def _status(server: TaskServerRow | None) -> str:
    return f'<div style="font-weight:600;margin-bottom:6px">{escape(_state(server))}</div>'


def _progress(row: TaskRow) -> str:
    if row.state == "QUEUED":
        return f"waits, done in {row.done_in:.1f} s"
    return f"{row.state.lower()}, {row.progress:.0%}, done in {row.done_in:.1f} s"


def _queue(server: TaskServerRow) -> str:
    rows = [
        (str(row.task_id), row.work, str(row.priority), _progress(row))
        for row in server.tasks[:_MOST_TASKS]
    ]
    if not rows:
        return ""
    more = server.queued - sum(row.state == "QUEUED" for row in server.tasks[:_MOST_TASKS])
    after = f'<div style="opacity:.7">and {more} more</div>' if more > 0 else ""
    return _table(("task", "work", "priority", "state"), rows, numbers=(0, 2)) + after


def _calls(calls: Iterable[EndedCall]) -> str:
    rows = [
        (_clock(call.at), _caller(call), call.service, call.result, f"{call.ms:g} ms")
        for call in calls
    ]
    return _table(("last calls", "from", "to", "result", "took"), rows, numbers=(4,))


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int]) -> str:
    def cells(row: Sequence[str], tag: str, more: str) -> str:
        return "".join(
            f'<{tag} style="{_RIGHT if column in numbers else _CELL}{more}">{escape(value)}</{tag}>'
            for column, value in enumerate(row)
        )

    lines = [f"<tr>{cells(head, 'th', ';font-weight:500;opacity:.7')}</tr>"]
    for row in rows:
        failed = "result" in head and row[3] != "OK"
        lines.append(f"<tr>{cells(row, 'td', f';color:{_ERROR}' if failed else '')}</tr>")
    style = "border-collapse:collapse;border:none;font-size:13px;margin:0 0 10px 0;color:inherit"
    return f'<table style="{style}">{"".join(lines)}</table>'


def _caller(call: EndedCall) -> str:
    return call.caller or "this notebook"


def _clock(seconds: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(seconds))


def _map(world: World, server: TaskServerRow, trail: Sequence[Point]) -> str:
    """The map as SVG, in metres; the y axis points up, as on the floor."""
    width, height = world.size
    scale = _WIDTH / width

    def at(point: Point) -> str:
        return f"{point[0] * scale:.1f},{(height - point[1]) * scale:.1f}"

    parts = [
        f'<rect x="1" y="1" width="{_WIDTH - 2}" height="{height * scale - 2:.1f}" fill="none"'
        ' stroke="currentColor" stroke-width="2" rx="3"/>'
    ]
    for box in world.obstacles:
        corners = " ".join(at(corner) for corner in box.corners())
        parts.append(f'<polygon points="{corners}" fill="currentColor" opacity=".45"/>')
    for name, place in world.places.items():
        x, y = at(place).split(",")
        parts.append(
            f'<circle cx="{x}" cy="{y}" r="4" fill="none" stroke="currentColor"/>'
            f'<text x="{x}" y="{float(y) + 17:.1f}" text-anchor="middle" font-size="12"'
            f' fill="currentColor">{escape(name)}</text>'
        )
    if len(trail) > 1:
        parts.append(
            f'<polyline points="{" ".join(map(at, trail))}" fill="none" stroke="{_ROBOT}"'
            ' stroke-width="2" opacity=".7"/>'
        )
    if (target := _target(world, server.tasks)) is not None:
        x, y = at(target).split(",")
        parts.append(
            f'<circle cx="{x}" cy="{y}" r="9" fill="none" stroke="{_TARGET}" stroke-width="2"/>'
        )
    if server.pose is not None:
        parts.append(_robot(server.pose, world.robot_radius * scale, at(server.pose[:2])))
    size = f'width="{_WIDTH}" height="{height * scale:.0f}"'
    view = f'viewBox="0 0 {_WIDTH} {height * scale:.1f}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="map" {size} {view}'
        f' style="max-width:100%;height:auto">{"".join(parts)}</svg>'
    )


def _robot(pose: Pose, radius: float, at: str) -> str:
    radius = max(radius, 8.0)
    nose = f"{radius * math.cos(pose.theta):.1f},{-radius * math.sin(pose.theta):.1f}"
    return (
        f'<g transform="translate({at})"><circle r="{radius:.1f}" fill="{_ROBOT}"/>'
        f'<path d="M0,0L{nose}" stroke="#fff" stroke-width="3" stroke-linecap="round"/></g>'
    )


def _target(world: World, tasks: Sequence[TaskRow]) -> Point | None:
    """Where the running task goes; None if none runs, or if the map does not know the place."""
    if not tasks or tasks[0].state == "QUEUED":
        return None
    try:
        return world.resolve(tasks[0].work.partition(" ")[2])
    except ValueError:
        return None
