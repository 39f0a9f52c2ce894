"""What the robots of a fleet offer: for refusals, and for tasks that wait for a certain robot."""

from __future__ import annotations

import difflib

from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.responses import printable, unknown_type

_LONGEST = 1000  # letters of a refusal, whatever the number of robots


def waits_for(state: FleetState, now: float, task: Task) -> str:
    """Return which robots a queued task waits for while none of them works, "" if one works."""
    able = state.abilities().of(task.task_type, task.target)
    robots = [robot for robot in state.known_robots(now) if robot.name in able]
    if not robots or any(robot.is_live(now) and not robot.paused for robot in robots):
        return ""
    waiting = [
        f"{robot.name}, which is {'paused' if robot.is_live(now) else 'away'}" for robot in robots
    ]
    return f"waits for {' or '.join(waiting)}"


def refuse_unable(state: FleetState, now: float, task_type: str, target: str) -> str:
    """Return that no robot can execute a task, with what the robots offer instead."""
    robots = state.live_robots(now) or state.known_robots(now)
    known = list(dict.fromkeys(each for robot in robots for each in robot.task_types))
    if task_type not in known:
        return unknown_type(task_type, known)
    offers: dict[str, list[str]] = {}
    for robot in robots:
        offers.setdefault(robot.offer(), []).append(robot.name)
    what = f"{printable(task_type)} at {printable(target.strip())}"
    places = [place for robot in robots for place in robot.places]
    near = difflib.get_close_matches(target.strip().casefold(), places, n=1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    offered = "; ".join(f"{', '.join(names)}: {offer}" for offer, names in offers.items())
    return f"Invalid target: no robot of the fleet is able to execute {what}{guess}. {offered}"[
        :_LONGEST
    ]
