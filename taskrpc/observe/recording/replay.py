"""Replays the decisions of a recorded run, and compares them with the recording, event for event.

The inputs come from the recording: which task was submitted, cancelled or moved, what the clock
showed. The queue and the robot's motion are computed again, with the same pure code and without any
clock. Equal inputs must give equal decisions, to the last digit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from taskrpc.observe.recording.decisions import DECISIONS_TOPIC, Decision, TaskChange, decision_of
from taskrpc.observe.recording.mcap_file import Recording, RecordingError
from taskrpc.robot.driver import WORK_SECONDS, KinematicRobot, task_result
from taskrpc.robot.journal import JournaledCourse, RobotStart, RobotStep
from taskrpc.robot.kinematics import Motion
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.queue.estimated_queue import RemovedTask
from taskrpc.robot.tasks.queue.journal import JournaledQueue, PlanMade, QueueStart, QueueStep
from taskrpc.robot.tasks.queue.schedule import Planner
from taskrpc.robot.world import World


class Difference(msgspec.Struct, frozen=True):
    """A decision that differs between the recording and its replay."""

    number: int
    """The number of the event in the recording, counted from 1."""
    time: float
    """Seconds since 1970."""
    event: str
    """Such as `accept task 3`."""
    field: str
    recorded: object
    replayed: object

    def __str__(self) -> str:
        return (
            f"event {self.number} ({self.event}): {self.field} was {self.recorded!r} in the"
            f" recording and is {self.replayed!r} in the replay"
        )


class ReplayReport(msgspec.Struct):
    """The result of a replay."""

    events: int = 0
    """How many decisions were compared."""
    differences: list[Difference] = []


class RecordedPlans:
    """A planner that returns the plans of the recording."""

    def __init__(self) -> None:
        self._plans: list[PlanMade] = []

    def expect(self, plans: tuple[PlanMade, ...]) -> None:
        """Use these plans for the next step."""
        self._plans = list(plans)

    def __call__(self, task: Task, start: Pose) -> Plan:
        """Return the next recorded plan; see `Planner`."""
        if not self._plans:
            return Plan(0.0, start)
        made = self._plans.pop(0)
        return Plan(made.seconds, made.end)


class QueueReplay:
    """Repeats the recorded steps of a queue.

    Args:
        start: the queue when it was made.
        plan: the robot's planner; the recorded plans if omitted.
    """

    def __init__(self, start: QueueStart, plan: Planner | None = None) -> None:
        self._recorded_plans = RecordedPlans()
        self._written: list[QueueStart | QueueStep] = []
        self.queue = JournaledQueue(
            plan or self._recorded_plans,
            start.start_pose,
            tolerance=start.tolerance,
            journal=self._written.append,
        )
        """The queue as it is after the repeated steps."""
        self._written.clear()
        self._tasks: dict[int, Task] = {}
        self._removed: dict[int, RemovedTask] = {}

    def step(self, step: QueueStep) -> list[QueueStep]:
        """Repeat a step; returns the steps that the replay writes, with its own decisions.

        Raises RecordingError if the step is impossible in the state of the replay.
        """
        self._recorded_plans.expect(step.plans)
        try:
            self._call(step)
        except (KeyError, ValueError, AssertionError, StopIteration, AttributeError) as error:
            problem = f"the recorded step {step.method!r} is impossible here: {error!r}"
            raise RecordingError(problem) from None
        written, self._written[:] = [*self._written], []
        return [each for each in written if isinstance(each, QueueStep)]

    def _call(self, step: QueueStep) -> None:
        queue, task = self.queue, step.task
        match step.method:
            case "set_free_at":
                queue.set_free_at(step.seconds, lambda: step.cause)
            case "set_start_pose" if step.pose is not None:
                queue.set_start_pose(step.pose, step.cause)
            case "accept" if task is not None:
                queue.accept(task, step.now)
            case "resume" if task is not None:
                queue.resume(task, step.now, waited=step.seconds)
            case "remove":
                self._removed[step.task_id] = queue.remove(step.task_id, step.cause)
            case "undo_remove":
                queue.undo_remove(self._removed.pop(step.task_id), step.cause)
            case "reprioritise":
                queue.reprioritise(step.task_id, step.priority)
            case "begin" if task is not None:
                queue.begin(task)
            case "undo_begin" if task is not None and step.pose is not None:
                queue.undo_begin(task, step.pose, step.seconds)
            case "end":
                queue.end(step.now)
            case method:
                raise ValueError(method)


class RobotReplay:
    """Repeats the recorded motion of a simulated robot.

    Args:
        start: the robot and its map before the first task.
    """

    def __init__(self, start: RobotStart) -> None:
        self.world: World = start.world.world()
        self._limits = start.limits
        self._written: list[RobotStart | RobotStep] = []
        self.course = JournaledCourse(
            start.standing.pose, self.world.dock, start.limits, self.world, self._written.append
        )
        """The robot's state after the repeated steps."""
        self._written.clear()
        self.task: Task | None = None
        """The task that the robot executes, or has executed last."""
        self._odometer = 0.0  # when the task begins
        robot = KinematicRobot(self.world, start=start.standing.pose, limits=start.limits)
        self._robot = robot

    def plan(self, task: Task, start: Pose) -> Plan:
        """Plan a task; see `Planner`."""
        return self._robot.plan(task.task_type, task.target, start)

    def begin(self, task: Task) -> None:
        """Note the task that the robot will execute next."""
        self.task, self._odometer = task, self.course.standing.odometer

    def step(self, step: RobotStep) -> RobotStep:
        """Repeat a step; returns the step that the replay writes, with its own decisions.

        Raises RecordingError if the step is impossible in the state of the replay.
        """
        course = self.course
        match step.method:
            case "assign":
                self._assign(step)
            case "forget_clock":
                course.forget_clock()
            case "go":
                course.go(step.now)
            case "halt":
                course.halt(step.now)
            case "complete":
                course.complete()
            case method:
                raise RecordingError(f"the recorded step {method!r} is unknown")
        written, self._written[:] = [*self._written], []
        found = next((each for each in written if isinstance(each, RobotStep)), None)
        if found is None:
            raise RecordingError(f"the recorded step {step.method!r} is impossible here")
        return found

    def result(self, task: Task) -> dict[str, object]:
        """Return the result of a task that has just succeeded."""
        distance = self.course.standing.odometer - self._odometer
        return task_result(task.task_type, self.world, self.course.standing, distance)

    def _assign(self, step: RobotStep) -> None:
        start, task = self.course.standing.pose, self.task
        if task is None or not (step.waypoints or step.work):  # the robot is free again
            self.course.assign(Motion(start, (), self._limits), 0.0)
            return
        waypoints = self.world.way((start.x, start.y), task.target)
        motion = Motion(start, waypoints, self._limits)
        self.course.assign(motion, WORK_SECONDS.get(task.task_type, 0.0))


def replay(recording: Recording) -> ReplayReport:
    """Replay the decisions of a recorded run and compare them with the recording.

    The motion and the plans of a robot class of the user's own are not computed again: its recorded
    plans are inputs of the queue.

    Raises RecordingError if the recording has no decisions, or they contradict each other.
    """
    comparison = _Comparison()
    for time, decision in decisions_of(recording):
        comparison.take(time, decision)
    if not comparison.report.events:
        problem = "has no decisions; record it with taskrpc-server --record"
        raise RecordingError(f"{recording.path} {problem}")
    return comparison.report


def decisions_of(recording: Recording) -> Iterator[tuple[float, Decision]]:
    """Iterate over the decisions of a recording, each with its seconds since 1970."""
    for message in recording.messages(keep=lambda topic: topic.name == DECISIONS_TOPIC):
        yield message.time / 1e9, decision_of(message)


class _Comparison:
    """Takes the recorded decisions, repeats them and collects the differences."""

    def __init__(self) -> None:
        self.report = ReplayReport(differences=[])
        self._queue: QueueReplay | None = None
        self._robot: RobotReplay | None = None
        self._results: dict[int, dict[str, object]] = {}
        """The replayed results of tasks whose end is not recorded yet."""

    def take(self, time: float, decision: Decision) -> None:
        self.report.events += 1
        match decision:
            case QueueStart():
                plan = self._robot.plan if self._robot is not None else None
                self._queue = QueueReplay(decision, plan)
            case RobotStart():
                self._robot = RobotReplay(decision)
            case QueueStep():
                self._take_queue(time, decision)
            case RobotStep() if self._robot is not None:
                self._compare(time, decision, [self._robot.step(decision)])
            case TaskChange():
                self._take_change(time, decision.task)
            case _:
                pass

    def _take_queue(self, time: float, step: QueueStep) -> None:
        if self._queue is None:
            raise RecordingError("the recording has a step of the queue before its start")
        first = next((task for task, _ in self._queue.queue.queue.ordered()), None)
        robot = self._robot
        if step.method == "begin" and step.task is not None:
            head = 0 if first is None else first.task_id
            self._differ(time, step, "the task that begins", step.task.task_id, head)
            if robot is not None:
                robot.begin(step.task)
        self._compare(time, step, list(self._queue.step(step)))

    def _take_change(self, time: float, task: Task) -> None:
        if self._robot is None or task.state is not TaskState.SUCCEEDED:
            return
        replayed = self._results.pop(task.task_id, None)
        if replayed is not None and task.result:
            recorded: Any = msgspec.json.decode(task.result)
            name = f"the result of task {task.task_id}"
            self._add(time, name, "result", recorded, msgspec.to_builtins(replayed))

    def _compare(
        self,
        time: float,
        recorded: QueueStep | RobotStep,
        replayed: list[Any],
    ) -> None:
        if isinstance(recorded, RobotStep) and recorded.method == "complete":
            self._keep_result()
        if not replayed:  # a `set_free_at` that decided nothing is written with the next step
            self._differ(time, recorded, "delays", getattr(recorded, "delays", ()), ())
            return
        for name in recorded.__struct_fields__:
            self._differ(time, recorded, name, getattr(recorded, name), getattr(replayed[-1], name))

    def _keep_result(self) -> None:
        robot = self._robot
        if robot is not None and (task := robot.task) is not None:
            self._results[task.task_id] = robot.result(task)

    def _differ(
        self, time: float, step: QueueStep | RobotStep, field: str, recorded: Any, replayed: Any
    ) -> None:
        self._add(time, _name_of(step), field, recorded, replayed)

    def _add(self, time: float, event: str, field: str, recorded: Any, replayed: Any) -> None:
        if recorded != replayed:
            number = self.report.events
            self.report.differences.append(
                Difference(number, time, event, field, recorded, replayed)
            )


def _name_of(step: QueueStep | RobotStep) -> str:
    if isinstance(step, RobotStep):
        return f"robot: {step.method}"
    task_id = step.task.task_id if step.task is not None else step.task_id
    return f"{step.method} task {task_id}" if task_id else step.method
