"""What a transaction of a fleet may change: leases, claims, ends, requests. All rules are pure.

What a request does to a task is decided in `robot.tasks.rules`, as for a server of one robot.

Each function reads and changes the state inside one transaction. `now` is the database's clock, in
seconds since 1970: no server's clock decides anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import TypeAlias

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.fleet.model import RobotRecord
from taskrpc.robot.fleet.offers import waits_for
from taskrpc.robot.fleet.plan import HORIZON, FleetPlan, Planned, Planner
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks import rules as requests
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.responses import SERVER_ENDED, TaskResponse, printable, task_queued


class Fenced(TaskRpcError):
    """Another server has ended this server's lease: nothing was written."""

    not_executed = True


class NameTaken(TaskRpcError):
    """Another server drives a robot of this name."""

    not_executed = True


Refusal: TypeAlias = Callable[[str, str], str]
"""Returns why a task type at a target cannot be executed, "" if it can."""


# Leases


def join(state: FleetState, now: float, robot: RobotRecord, lease: float) -> RobotRecord:
    """Give a robot to the server that starts; returns its record, with a new epoch.

    Raises:
        NameTaken: the server of another robot of this name holds a lease.
    """
    before = state.robots.get(robot.name)
    epoch = 1
    if before is not None:
        if before.is_live(now) and before.server != robot.server:
            where = f" ({before.process})" if before.process else ""
            raise NameTaken(
                f"another server{where} drives {robot.name!r}: give each robot of the fleet a"
                " name of its own with --robot-name; if that server has crashed, its lease ends in"
                f" {before.lease_until - now:.1f} s"
            )
        if before.task_id:
            _interrupt(state, now, before, SERVER_ENDED)
        epoch = before.epoch + 1
        # An operator has paused the robot, not its server: a restart does not end that.
        robot = msgspec.structs.replace(robot, paused=before.paused, halts=before.halts)
    joined = msgspec.structs.replace(
        robot, epoch=epoch, lease_until=now + lease, free_at=now, task_id=0, is_gone=False
    )
    state.put_robot(joined)
    return joined


def renew(
    state: FleetState,
    now: float,
    name: str,
    epoch: int,
    lease: float,
    *,
    remaining: float = 0.0,
    progress: float = 0.0,
    pose: Pose | None = None,
) -> float:
    """Renew the lease, and note how the task proceeds; returns when the lease ends.

    `remaining` is in real seconds, 0.0 if the robot was idle; `pose` is where it was.

    Raises:
        Fenced: the lease was taken away.
    """
    expire(state, now)
    robot = own(state, name, epoch)
    notifies = False
    if robot.task_id and remaining > 0:  # else the report is older than the claim
        robot = msgspec.structs.replace(robot, free_at=now + remaining)
        task = state.tasks.get(robot.task_id)
        if task is not None and progress > task.progress:
            state.put_task(msgspec.structs.replace(task, progress=progress))
            notifies = True
    elif not robot.task_id and not remaining and pose is not None and pose != robot.pose:
        robot = msgspec.structs.replace(robot, pose=pose)
        notifies = True
    renewed = msgspec.structs.replace(robot, lease_until=now + lease, at=pose or robot.at)
    state.put_robot(renewed, notifies=notifies)
    return now + lease


def expire(state: FleetState, now: float) -> list[str]:
    """Interrupt the tasks of robots whose lease has ended; returns the names of these robots."""
    lost = [robot for robot in state.robots.values() if not robot.is_gone]
    lost = [robot for robot in lost if robot.lease_until <= now]
    for robot in lost:
        reason = f"the server of {robot.name} did not renew its lease while it ran"
        _release(state, now, robot, reason)
    return [robot.name for robot in lost]


def leave(state: FleetState, now: float, name: str, epoch: int) -> None:
    """Give up the lease, because the server ends. Raises Fenced."""
    _release(state, now, own(state, name, epoch), SERVER_ENDED)


def own(state: FleetState, name: str, epoch: int) -> RobotRecord:
    """Return the record of a server's own robot.

    Raises:
        Fenced: the lease of this epoch was taken away.
    """
    robot = state.robots.get(name)
    if robot is None or robot.is_gone or robot.epoch != epoch:
        raise Fenced(
            f"the lease of {name} has ended: its server could not renew it in time,"
            " and another server has ended it"
        )
    return robot


def _release(state: FleetState, now: float, robot: RobotRecord, reason: str) -> None:
    if robot.task_id:
        _interrupt(state, now, robot, reason)
    # A new epoch: whatever this server still tries to write is refused.
    state.put_robot(
        msgspec.structs.replace(
            robot,
            is_gone=True,
            epoch=robot.epoch + 1,
            task_id=0,
            lease_until=min(now, robot.lease_until),
        )
    )


def _interrupt(state: FleetState, now: float, robot: RobotRecord, reason: str) -> None:
    task = state.tasks.get(robot.task_id)
    if task is not None and task.state.is_begun and task.robot == robot.name:
        state.put_task(task.ended(TaskState.INTERRUPTED, now, message=reason))


# Execution


def may_claim(state: FleetState, now: float, name: str, planner: Planner, refusal: Refusal) -> bool:
    """Return whether `claim` would probably change anything, by what this server knows."""
    robot = state.robots.get(name)
    if robot is None or state.meta.paused or robot.paused or not len(state):
        return robot is not None and robot.task_id > 0
    return (
        robot.task_id > 0
        or _next_task(state, now, robot, planner) is not None
        or any(_impossible(state, now, robot, refusal))
    )


def claim(
    state: FleetState, now: float, name: str, epoch: int, planner: Planner, refusal: Refusal
) -> tuple[Task, Plan] | None:
    """Let an idle robot begin the task that the plan gives to it next; None if there is none.

    Returns the task, RUNNING, and its plan. A task that the robot has claimed before, without
    having begun it, is put back first. A task that only this robot could execute, and that its
    `refusal` refuses, would wait for ever: it becomes FAILED.

    Raises:
        Fenced: the lease has ended.
    """
    expire(state, now)
    robot = own(state, name, epoch)
    if robot.task_id:
        robot = _put_back(state, now, robot)
    if state.meta.paused or robot.paused or not len(state):
        return None
    for refused_task, problem in list(_impossible(state, now, robot, refusal)):
        failed = refused_task.started(now).ended(TaskState.FAILED, now, message=problem)
        state.put_task(msgspec.structs.replace(failed, robot=name))
    task = _next_task(state, now, robot, planner)
    plan = planner(robot, task.task_type, task.target, robot.pose) if task else None
    if task is None or plan is None:
        return None
    started = msgspec.structs.replace(task.started(now), robot=name)
    state.put_task(started)
    free_at = now + plan.seconds / robot.speed
    state.put_robot(
        msgspec.structs.replace(robot, task_id=task.task_id, pose=plan.end, free_at=free_at)
    )
    return started, plan


def _put_back(state: FleetState, now: float, robot: RobotRecord) -> RobotRecord:
    """Undo a claim that may have been committed although its connection was lost.

    The robot has not moved for it."""
    task = state.tasks.get(robot.task_id)
    if task is not None and task.state.is_begun and task.robot == robot.name:
        if task.state is TaskState.CANCELING:
            state.put_task(task.ended(TaskState.CANCELED, now, message=task.message))
        else:
            queued = msgspec.structs.replace(
                task, state=TaskState.QUEUED, started_at=None, robot="", message=""
            )
            state.put_task(queued)
    idle = msgspec.structs.replace(robot, task_id=0, free_at=now)
    state.put_robot(idle)
    return idle


def _next_task(state: FleetState, now: float, robot: RobotRecord, planner: Planner) -> Task | None:
    robots, abilities = state.working_robots(now), state.abilities()
    plan = FleetPlan(state.queued_at, robots, abilities, now, planner, own=robot.name)
    if (planned := plan.first_of(robot.name)) is not None:
        return state.tasks[planned.task_id]
    if len(state) <= HORIZON:
        return None
    # All that is planned is for other robots. This robot is free, so it takes what it can.
    for index, task in enumerate(state.queued()):
        if index >= HORIZON and robot.name in abilities.of(task.task_type, task.target):
            return task
    return None


def _impossible(
    state: FleetState, now: float, robot: RobotRecord, refusal: Refusal
) -> Iterator[tuple[Task, str]]:
    """Yield the queued tasks that only this robot could execute and that it refuses, with why."""
    abilities, known = state.abilities(), {each.name for each in state.known_robots(now)}
    for task in islice(state.queued(), HORIZON):
        if abilities.of(task.task_type, task.target) & known == {robot.name}:
            problem = refusal(task.task_type, task.target)
            if problem:
                yield task, problem


def update(
    state: FleetState, now: float, name: str, epoch: int, task: Task, pose: Pose | None = None
) -> None:
    """Store a change of the task that the robot executes; `pose` is where it is after its end.

    Raises:
        Fenced: the lease was taken away.
    """
    robot = own(state, name, epoch)
    before = state.tasks.get(task.task_id)
    if before is not None and not robot.task_id and _is_same_end(before, task, name):
        return  # The first attempt took effect, but its connection was lost before the answer.
    if robot.task_id != task.task_id or before is None:
        raise Fenced(f"{name} does not execute task {task.task_id} any more")
    if task.state.is_ended:
        # A cancel at another server may have changed the state meanwhile; the end counts.
        ended = msgspec.structs.replace(
            task,
            started_at=before.started_at,
            ended_at=now,
            robot=name,
            decisions=before.decisions,
        )
        state.put_task(ended.with_decisions(*task.decisions))
        after = robot.pose if pose is None else pose
        state.put_robot(msgspec.structs.replace(robot, task_id=0, pose=after, free_at=now))
    elif task.state is not before.state and task.state in before.may_become:
        state.put_task(msgspec.structs.replace(before, state=task.state, progress=task.progress))


def _is_same_end(before: Task, task: Task, name: str) -> bool:
    return before.state is task.state and task.state.is_ended and before.robot == name


# Requests of clients


def submit(
    state: FleetState,
    now: float,
    task: Task,
    *,
    account: str,
    unable: str,
    queue_limit: int,
    share: int | None,
    estimated: Callable[[Task], float],
) -> TaskResponse:
    """Queue a new task, or refuse it; its id, its arrival and its time are set here.

    `unable` says why no robot can execute it, "" if one can. `estimated` returns the robot seconds
    until a queued task ends.
    """
    priority, machine = task.priority, task.machine
    if problem := requests.refusal(unable, priority, state, queue_limit, share, account, machine):
        return TaskResponse(False, problem)
    task_id = state.meta.next_id
    state.set_meta(next_id=task_id + 1)
    arrival = _new_arrival(state)
    new = msgspec.structs.replace(task, task_id=task_id, arrival=arrival, submitted_at=now)
    return _queue(state, now, new, estimated)


def carry_out(
    state: FleetState,
    now: float,
    decision: requests.Decision,
    estimated: Callable[[Task], float],
) -> TaskResponse:
    """Change the state as a rule has decided; returns the response."""
    match decision:
        case requests.Change(task, message):
            state.put_task(task)
            return _with_estimate(state, TaskResponse(True, message, task.task_id), estimated)
        case requests.Halt(task):
            if state.tasks[task.task_id] != task:
                state.put_task(task)
            return requests.halted(task, is_over=False)
        case requests.Enqueue(task, keeps_arrival):
            arrival = task.arrival if keeps_arrival else _new_arrival(state)
            return _queue(state, now, task.requeued(now, arrival), estimated)
        case _:
            return _with_estimate(state, decision, estimated)


def _with_estimate(
    state: FleetState, response: TaskResponse, estimated: Callable[[Task], float]
) -> TaskResponse:
    task = state.tasks.get(response.task_id)
    if task is None or task.state is not TaskState.QUEUED:
        return response
    return msgspec.structs.replace(response, estimated_time=estimated(task))


def _new_arrival(state: FleetState) -> int:
    arrival = state.meta.next_arrival
    state.set_meta(next_arrival=arrival + 1)
    return arrival


def _queue(
    state: FleetState, now: float, task: Task, estimated: Callable[[Task], float]
) -> TaskResponse:
    state.put_task(task)
    seconds = estimated(task)
    state.put_task(msgspec.structs.replace(task, accepted_estimate=seconds))
    note = waits_for(state, now, task)
    return task_queued(task, seconds, paused=state.meta.paused, note=note)


def pause(state: FleetState, paused: bool) -> None:
    """Remember whether the queue is paused."""
    if state.meta.paused != paused:
        state.set_meta(paused=paused)


def stop(state: FleetState, now: float, reason: str, client: str) -> None:
    """Let all servers halt their robots at once, and pause the queue."""
    _note_stop(state, now, "", client)
    state.set_meta(paused=True, halts=state.meta.halts + 1, halt_reason=reason)


def pause_robot(state: FleetState, now: float, name: str, paused: bool) -> TaskResponse:
    """Remember whether an operator has paused one robot."""
    robot = state.robots.get(name)
    if robot is None:
        return TaskResponse(False, _no_robot(state, name))
    if robot.paused != paused:
        state.put_robot(msgspec.structs.replace(robot, paused=paused))
    notes = [] if robot.is_live(now) else ["its server does not run"]
    if not paused and state.meta.paused:
        notes.append("the queue is still paused (taskrpc task resume continues it)")
    said = "paused; the other robots continue" if paused else "resumed"
    return TaskResponse(True, "; ".join([f"{name} is {said}", *notes]))


def stop_robot(state: FleetState, now: float, name: str, reason: str, client: str) -> TaskResponse:
    """Let the server of one robot halt it at once, and pause this robot."""
    robot = state.robots.get(name)
    if robot is None:
        return TaskResponse(False, _no_robot(state, name))
    _note_stop(state, now, name, client)
    stopped = msgspec.structs.replace(robot, paused=True, halts=robot.halts + 1, halt_reason=reason)
    state.put_robot(stopped)
    if not robot.is_live(now):
        return TaskResponse(True, f"{name} is paused; its server does not run")
    return TaskResponse(True, f"{name} is stopped and paused; the other robots continue")


def _note_stop(state: FleetState, now: float, name: str, client: str) -> None:
    for task_id in executed_by(state, name):
        task = state.tasks.get(task_id)
        if task is not None and task.state is not TaskState.CANCELING:  # the first reason counts
            state.put_task(task.decided(now, client, "stopped"))


def executed_by(state: FleetState, name: str) -> list[int]:
    """Return the ids of the tasks that one robot executes, or all robots if `name` is ""."""
    robots = state.robots.values()
    return [robot.task_id for robot in robots if robot.task_id and name in ("", robot.name)]


def paused_robots(state: FleetState) -> list[str]:
    """Return the names of the robots that an operator has paused by name."""
    return sorted(robot.name for robot in state.robots.values() if robot.paused)


def _no_robot(state: FleetState, name: str) -> str:
    known = ", ".join(sorted(state.robots)) or "none yet"
    return f"There is no robot {printable(name)!r} in the fleet (expected one of: {known})"


# Estimates


def planned(state: FleetState, now: float, planner: Planner, own: str) -> FleetPlan:
    """Return the plan of the present queue."""
    return FleetPlan(
        state.queued_at, state.working_robots(now), state.abilities(), now, planner, own=own
    )


def end_of(state: FleetState, plan: FleetPlan, task: Task) -> Planned | float | None:
    """Return the place of a queued task in the plan, or only when it ends if it is far behind.

    None if no robot can execute it.
    """
    return _end_at(state, plan, task, state.position(task))


def end_of_new(
    state: FleetState, now: float, task: Task, planner: Planner, own: str
) -> Planned | float | None:
    """Return what `end_of` would return if this task were queued; `task` has no id."""
    place = state.position(task) + 1  # as if it were there already

    def task_at(position: int) -> Task | None:
        if position == place:
            return task
        return state.queued_at(position if position < place else position - 1)

    robots, abilities = state.working_robots(now), state.abilities()
    plan = FleetPlan(task_at, robots, abilities, now, planner, own=own)
    return _end_at(state, plan, task, place)


def _end_at(
    state: FleetState, plan: FleetPlan, task: Task, position: int
) -> Planned | float | None:
    behind = position - HORIZON + 1
    if behind <= 0:
        return plan.find(task.task_id)
    able = state.abilities().of(task.task_type, task.target)
    if not any(robot.name in able for robot in plan.robots):
        return None
    return plan.free_at() + behind * plan.seconds_for_each()
