"""The demo's story: three clients, a task server and a robot, in memory and seen by nobody else.

The clients follow a script; a spectator follows the server's own services and tells what happens.
All times are robot seconds since the story began.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AsyncExitStack, aclosing, asynccontextmanager
from typing import Any, NamedTuple, TypeAlias

from taskrpc.cli.task.task_services import TaskRefused, TaskServices
from taskrpc.cli.task.view import result, what
from taskrpc.node import Node
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.tasks import MemoryStore, TaskServer

SPEED = 4.5
"""Robot seconds a second at which the story takes about twelve seconds."""

CLIENTS = ("client_1", "client_2", "client_3")

_SPECTATOR = "spectator"
_TOLD = 0.05  # seconds by which an estimate must move to be told


class Submit(NamedTuple):
    """A client submits a task."""

    at: float
    client: str
    task_type: str
    target: str
    priority: int


class Cancel(NamedTuple):
    """A client calls off the task that it submitted last."""

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
"""What the clients do, in the order of time."""


class Line(NamedTuple):
    """Something that happened."""

    at: float
    who: str
    text: str


class Stage:
    """What can be seen of the story while it goes on.

    Args:
        robot: the robot, on its map.
        on_line: is told each line.
    """

    def __init__(self, robot: KinematicRobot, on_line: Callable[[Line], None]) -> None:
        self.robot = robot
        self.tasks: list[Any] = []
        """TaskInfo messages: what runs, the queue in the order of run, what has ended."""
        self.lines: list[Line] = []
        self.said: dict[str, str] = {}
        """What each client asked last, and the answer."""
        self._on_line = on_line
        self._began = asyncio.get_running_loop().time()

    def now(self) -> float:
        """Robot seconds since the story began."""
        return (asyncio.get_running_loop().time() - self._began) * self.robot.speed

    def tell(self, who: str, text: str, brief: str = "") -> None:
        """Say what happened; `brief` is what a client's own few columns show of it."""
        line = Line(self.now(), who, text)
        self.lines.append(line)
        if brief:
            self.said[who] = brief
        self._on_line(line)

    async def until(self, at: float) -> None:
        """Wait for an instant of the story."""
        await asyncio.sleep((at - self.now()) / self.robot.speed)


@asynccontextmanager
async def open_stage(
    *, speed: float = SPEED, on_line: Callable[[Line], None] = lambda _: None
) -> AsyncIterator[Stage]:
    """A task server with its robot, ready for `perform`."""
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
        news = await stack.enter_async_context(aclosing(spectator.services.follow(seconds=0.5)))
        async for update in news:
            await spectator.look(update.tasks)
            if playing.done() and spectator.seen_to_end >= playing.result():
                break
        return [await spectator.services.show(task_id) for task_id in sorted(playing.result())]


async def _joined(name: str, stack: AsyncExitStack) -> TaskServices:
    # A token of its own gives each client a connection of its own, as if it were a program.
    node = await stack.enter_async_context(Node(name, transport="memory", token=name))
    return TaskServices(node)


async def _play(
    stage: Stage, script: Sequence[Act], crew: dict[str, TaskServices], spectator: _Spectator
) -> set[int]:
    """Let the clients do what the script says; returns the numbers of their tasks."""
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
        await spectator.tell_changes()
    return accepted


async def _submit(stage: Stage, act: Submit, services: TaskServices) -> int:
    """Submit a task; returns its number, 0 if it was refused."""
    asked = f"{act.task_type} {act.target} {act.priority}"
    try:
        answer = await services.submit(act.task_type, act.target, act.priority)
    except TaskRefused as refusal:
        brief = str(refusal).partition(" (")[0]
        stage.tell(act.client, f"{asked} -> {refusal}", brief)
        return 0
    told = f"{answer.message} (task {answer.task_id}, done in {answer.estimated_time:.1f} s)"
    brief = f"{asked} -> task {answer.task_id}"
    stage.tell(act.client, f"{asked} -> {told}", brief)
    return int(answer.task_id)


async def _cancel(stage: Stage, act: Cancel, services: TaskServices, task_id: int) -> None:
    answer = await services.ask("/cancel", task_id=task_id)
    stage.tell(act.client, f"cancel task {task_id} -> {answer.message}", f"cancel task {task_id}")


class _Spectator:
    """Watches the server through its services and tells what becomes of the tasks."""

    def __init__(self, stage: Stage, services: TaskServices) -> None:
        self.services = services
        self.seen_to_end: set[int] = set()
        self._stage = stage
        self._states: dict[int, str] = {}
        self._delays: dict[tuple[int, str], float] = {}  # of a task, by cause, as told

    async def look(self, changed: Iterable[Any]) -> None:
        """Take in what changed, and the whole list for the picture."""
        for task in changed:
            if task.state != self._states.get(task.task_id):
                self._states[task.task_id] = task.state
                await self._tell_state(task)
            if task.ended.sec:
                self.seen_to_end.add(task.task_id)
        self._stage.tasks = await self.services.tasks(ended=True)

    async def tell_changes(self) -> None:
        """Tell whose estimates have moved, and why."""
        moved: dict[tuple[str, str], list[int]] = {}
        for task in await self.services.tasks():
            for cause, delay in await self._new_delays(task.task_id):
                moved.setdefault((cause, f"{delay:+.1f} s"), []).append(task.task_id)
        for (cause, seconds), task_ids in moved.items():
            numbers = " ".join(str(task_id) for task_id in task_ids)
            plural = "s" if len(task_ids) > 1 else ""
            self._stage.tell("server", f"task{plural} {numbers} {seconds}: {cause}")

    async def _new_delays(self, task_id: int) -> list[tuple[str, float]]:
        changes = (await self.services.show(task_id)).estimate_changes
        totals: dict[str, float] = {}
        for change in changes:
            totals[change.cause] = totals.get(change.cause, 0.0) + change.seconds
        new = []
        for cause, seconds in totals.items():
            delay = seconds - self._delays.get((task_id, cause), 0.0)
            if abs(delay) >= _TOLD:
                self._delays[task_id, cause] = seconds
                new.append((cause, delay))
        return new

    async def _tell_state(self, task: Any) -> None:
        if task.state == task.RUNNING:
            self._stage.tell("robot", f"task {task.task_id} begins: {what(task)}")
        elif task.ended.sec:
            found = _found(result(await self.services.show(task.task_id)))
            self._stage.tell("robot", f"task {task.task_id} {task.state}{found}")


def _found(found: dict[str, Any] | None) -> str:
    """What the robot brought home, in a few words."""
    if found is None:
        return ""
    if "ranges" in found:
        return f": {len(found['ranges'])} ranges, the nearest {min(found['ranges']):.2f} m"
    if "battery" in found:
        return f": battery {found['battery']:.1f} %, odometer {found['odometer']:.1f} m"
    return f": at {found['pose']['x']:.1f}, {found['pose']['y']:.1f}"
