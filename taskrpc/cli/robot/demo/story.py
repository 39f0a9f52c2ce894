"""The demo's story: three clients, a task server and a robot, in memory and invisible to others.

The clients follow a script. A spectator watches the server through its services and reports events.
All times are robot seconds since the story began.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AsyncExitStack, aclosing, asynccontextmanager
from typing import Any, NamedTuple, TypeAlias

from taskrpc.cli.robot.task.task_services import TaskRefused, TaskServices
from taskrpc.cli.robot.task.view import result
from taskrpc.node import Node
from taskrpc.observe.texts import work_of
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer

SPEED = 4.5
"""Robot seconds per second; the story then takes about twelve seconds."""

CLIENTS = ("client_1", "client_2", "client_3")

_SPECTATOR = "spectator"
_LEAST_DELAY = 0.05  # robot seconds; smaller changes of an estimate are not reported


class Submit(NamedTuple):
    """A client submits a task."""

    at: float
    client: str
    task_type: str
    target: str
    priority: int


class Cancel(NamedTuple):
    """A client cancels the task that it submitted last."""

    at: float
    client: str


Act: TypeAlias = Submit | Cancel

SCRIPT: Sequence[Act] = (
    Submit(0.0, "client_1", "move", "warehouse", 8),  # these four are the lecture's
    Submit(0.0, "client_2", "scan", "area_a", 9),
    Submit(0.0, "client_1", "move", "station_1", 5),
    Submit(0.0, "client_3", "report", "central", 3),
    Submit(2.5, "client_2", "fly", "moon", 9),
    Submit(4.0, "client_3", "report", "dock", 1),
    Submit(5.5, "client_1", "scan", "2,3", 4),
    Submit(8.5, "client_2", "scan", "central", 10),
    Cancel(21.0, "client_1"),
)
"""The actions of the clients, in the order of time."""


class Line(NamedTuple):
    """An event of the story."""

    at: float
    """In robot seconds since the story began."""
    actor: str
    """A client, `server` or `robot`."""
    text: str


class Stage:
    """The visible state of the story while it runs.

    Args:
        robot: the robot, on its map.
        on_line: gets each new line.
    """

    def __init__(self, robot: KinematicRobot, on_line: Callable[[Line], None]) -> None:
        self.robot = robot
        self.tasks: list[Any] = []
        """TaskInfo messages: the running task, the queue in order, the ended tasks."""
        self.lines: list[Line] = []
        self.requests: dict[str, str] = {}
        """The last request of each client, with the response, as short text."""
        self._on_line = on_line
        self._began = asyncio.get_running_loop().time()

    def now(self) -> float:
        """Robot seconds since the story began."""
        return (asyncio.get_running_loop().time() - self._began) * self.robot.speed

    def report(self, actor: str, text: str, brief: str = "") -> None:
        """Add a line; `brief` is the short text for the panel of the clients."""
        line = Line(self.now(), actor, text)
        self.lines.append(line)
        if brief:
            self.requests[actor] = brief
        self._on_line(line)

    async def until(self, at: float) -> None:
        """Wait for an instant of the story."""
        await asyncio.sleep((at - self.now()) / self.robot.speed)


@asynccontextmanager
async def open_stage(
    *, speed: float = SPEED, on_line: Callable[[Line], None] = lambda _: None
) -> AsyncIterator[Stage]:
    """Run a task server with its robot; yields the stage for `perform`."""
    loop = asyncio.get_running_loop()
    robot = KinematicRobot(default_world(), speed=speed)
    async with (
        Node("task_server", transport="memory") as node,
        TaskServer(node, robot, MemoryStore(), wall_clock=lambda: 1.0 + loop.time()),
    ):
        yield Stage(robot, on_line)


async def perform(stage: Stage, script: Sequence[Act] = SCRIPT) -> list[Any]:
    """Play the script until all its tasks have ended; returns them as TaskInfo messages."""
    async with AsyncExitStack() as stack:
        crew = {name: await _joined(name, stack) for name in (_SPECTATOR, *CLIENTS)}
        spectator = _Spectator(stage, crew[_SPECTATOR])
        playing = asyncio.create_task(_play(stage, script, crew, spectator))
        stack.callback(playing.cancel)
        updates = await stack.enter_async_context(aclosing(spectator.services.follow(seconds=0.5)))
        async for update in updates:
            await spectator.look(update.tasks)
            if playing.done() and spectator.seen_to_end >= playing.result():
                break
        return [await spectator.services.show(task_id) for task_id in sorted(playing.result())]


async def _joined(name: str, stack: AsyncExitStack) -> TaskServices:
    # With different tokens, each client gets a separate connection, as a separate program would.
    node = await stack.enter_async_context(Node(name, transport="memory", token=name))
    return TaskServices(node)


async def _play(
    stage: Stage, script: Sequence[Act], crew: dict[str, TaskServices], spectator: _Spectator
) -> set[int]:
    """Let the clients act as in the script; returns the numbers of their tasks."""
    newest: dict[str, int] = {}
    accepted: set[int] = set()
    for act in script:
        await stage.until(act.at)
        if isinstance(act, Submit):
            task_id = await _submit(stage, act, crew[act.client])
            if task_id:
                newest[act.client] = task_id
                accepted.add(task_id)
        else:
            await _cancel(stage, act, crew[act.client], newest[act.client])
        await spectator.report_changes()
    return accepted


async def _submit(stage: Stage, act: Submit, services: TaskServices) -> int:
    """Submit a task; returns its number, 0 if it was refused."""
    request = f"{act.task_type} {act.target} {act.priority}"
    try:
        response = await services.submit(act.task_type, act.target, act.priority)
    except TaskRefused as refusal:
        brief = str(refusal).partition(" (")[0]
        stage.report(act.client, f"{request} -> {refusal}", brief)
        return 0
    estimate = f"task {response.task_id}, done in {response.estimated_time:.1f} s"
    brief = f"{request} -> task {response.task_id}"
    stage.report(act.client, f"{request} -> {response.message} ({estimate})", brief)
    return int(response.task_id)


async def _cancel(stage: Stage, act: Cancel, services: TaskServices, task_id: int) -> None:
    response = await services.request("/cancel", task_id=task_id)
    brief = f"cancel task {task_id}"
    stage.report(act.client, f"{brief} -> {response.message}", brief)


class _Spectator:
    """Watches the server through its services and reports what happens to the tasks."""

    def __init__(self, stage: Stage, services: TaskServices) -> None:
        self.services = services
        self.seen_to_end: set[int] = set()
        """The numbers of the tasks that have ended."""
        self._stage = stage
        self._states: dict[int, str] = {}
        self._delays: dict[tuple[int, str], float] = {}
        """The reported delays in robot seconds, by task number and cause."""

    async def look(self, changed: Iterable[Any]) -> None:
        """Report the changed tasks, and read the list of all tasks for the picture."""
        for task in changed:
            if task.state != self._states.get(task.task_id):
                self._states[task.task_id] = task.state
                await self._report_state(task)
            if task.ended.sec:
                self.seen_to_end.add(task.task_id)
        self._stage.tasks = await self.services.tasks(ended=True)

    async def report_changes(self) -> None:
        """Report which estimates have changed, and why."""
        moved: dict[tuple[str, str], list[int]] = {}
        for task in await self.services.tasks():
            for cause, delay in await self._new_delays(task.task_id):
                moved.setdefault((cause, f"{delay:+.1f} s"), []).append(task.task_id)
        for (cause, seconds), task_ids in moved.items():
            numbers = " ".join(str(task_id) for task_id in task_ids)
            plural = "s" if len(task_ids) > 1 else ""
            self._stage.report("server", f"task{plural} {numbers} {seconds}: {cause}")

    async def _new_delays(self, task_id: int) -> list[tuple[str, float]]:
        changes = (await self.services.show(task_id)).estimate_changes
        totals: dict[str, float] = {}
        for change in changes:
            totals[change.cause] = totals.get(change.cause, 0.0) + change.seconds
        new = []
        for cause, seconds in totals.items():
            delay = seconds - self._delays.get((task_id, cause), 0.0)
            if abs(delay) >= _LEAST_DELAY:
                self._delays[task_id, cause] = seconds
                new.append((cause, delay))
        return new

    async def _report_state(self, task: Any) -> None:
        if task.state == task.RUNNING:
            self._stage.report("robot", f"task {task.task_id} begins: {work_of(task)}")
        elif task.ended.sec:
            found = _summary(result(await self.services.show(task.task_id)))
            self._stage.report("robot", f"task {task.task_id} {task.state}{found}")


def _summary(found: dict[str, Any] | None) -> str:
    """Return the result of a task in a few words."""
    if found is None:
        return ""
    if "ranges" in found:
        return f": {len(found['ranges'])} ranges, the nearest {min(found['ranges']):.2f} m"
    if "battery" in found:
        return f": battery {found['battery']:.1f} %, odometer {found['odometer']:.1f} m"
    return f": at {found['pose']['x']:.1f}, {found['pose']['y']:.1f}"
