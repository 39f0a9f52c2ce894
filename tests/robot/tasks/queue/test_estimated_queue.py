"""The accepted estimate of a task plus its changes is the time of its end."""

import asyncio

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from taskrpc.errors import StoreError
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.testing import VirtualTimeLoop
from tests.properties import examples
from tests.robot.tasks.fakes import LineRobot

submits = st.tuples(st.just("submit"), st.integers(0, 5), st.integers(1, 10))
meddling = st.one_of(
    st.tuples(st.sampled_from(["cancel", "requeue"]), st.integers(1, 12), st.none()),
    st.tuples(st.just("reprioritise"), st.integers(1, 12), st.integers(1, 10)),
    st.tuples(st.sampled_from(["pause", "resume", "stop"]), st.none(), st.none()),
)
refusals = st.tuples(st.just("refused"), st.integers(1, 12), st.integers(0, 10))
pauses = st.tuples(st.just("sleep"), st.floats(0.0, 8.0), st.none())


def until(condition):
    """Wait in virtual time."""

    async def wait():
        while not condition():
            await asyncio.sleep(0.05)

    return wait()


class StubbornStore(MemoryStore):
    """A slow store that refuses every change of one queued task."""

    stubborn = 0

    async def apply(self, saved, forgotten=(), completion=None, clients=()):
        if self.stubborn and [task.task_id for task in saved] == [self.stubborn]:
            await asyncio.sleep(1.5)
            raise StoreError("the disk is full")
        await super().apply(saved, forgotten, completion, clients)


class Witness:
    """Notes, on the robot's clock, when each task was last accepted and when it ended."""

    def __init__(self, manager, robot):
        self.manager, self.robot = manager, robot
        self.accepted, self.ended = {}, {}

    def now(self):
        return asyncio.get_running_loop().time() * self.robot.speed

    async def watch(self):
        revision = self.manager.change_feed.revision
        while True:
            await self.manager.change_feed.wait_for_change(revision, 1e9)
            for task_id in self.manager.change_feed.changed_since(revision):
                task = self.manager.repository.find(task_id)
                if task.state.is_ended:
                    self.ended[task_id] = self.now()
            revision = self.manager.change_feed.revision

    async def do(self, action, a, b):
        manager = self.manager
        match action:
            case "submit":
                answer = await manager.submit("move", str(a), b)
                self.accepted[answer.task_id] = self.now()
            case "requeue":
                answer = await manager.requeue(a)
                if answer.message.startswith("Task queued"):
                    self.accepted[a] = self.now()
            case "sleep":
                await asyncio.sleep(a / self.robot.speed)
            case "pause" | "resume" | "stop":
                await getattr(manager, action)()
            case "cancel":
                await manager.cancel(a)
            case "refused" if a in manager.queue:
                await self.be_refused(a, b)
            case "refused":
                pass
            case _:
                await manager.reprioritise(a, b)

    async def be_refused(self, number, priority):
        """Cancel or move a task while the disk is full; then all is as it was."""
        before = self.manager.queue.find(number)
        self.manager.repository._store.stubborn = number
        manager = self.manager
        asked = manager.reprioritise(number, priority) if priority else manager.cancel(number)
        with pytest.raises(StoreError):
            await asked
        self.manager.repository._store.stubborn = 0
        assert self.manager.queue.find(number) == before

    def check_succeeded(self):
        """Compare for every task that ran to its end; return their number."""
        done = [t for t in self.manager.repository.ended() if t.state is TaskState.SUCCEEDED]
        for task in done:
            took = self.ended[task.task_id] - self.accepted[task.task_id]
            said = task.accepted_estimate + sum(change.seconds for change in task.changes)
            assert said == pytest.approx(took, rel=0.01, abs=0.01), (task, took)
        return len(done)


async def rehearse(robot, actions):
    """Do the actions, execute all tasks, and compare the estimates with the ends."""
    manager = TaskManager(robot, StubbornStore(), TaskSettings(settle=0.1))
    await manager.start()
    witness = Witness(manager, robot)
    watcher = asyncio.ensure_future(witness.watch())
    for action in actions:
        await witness.do(*action)
    await manager.resume()
    await until(lambda: not manager.queue and manager.running is None)
    await asyncio.sleep(1)
    watcher.cancel()
    await manager.close()
    return manager, witness


def virtually(coroutine):
    loop = VirtualTimeLoop()
    try:
        return loop.run_until_complete(coroutine)
    finally:
        loop.close()


@example(actions=[("submit", 0, 1), ("sleep", 0.1, None)], speed=1.0)  # resumed as its run begins
@settings(max_examples=examples(40))
@given(actions=st.lists(st.one_of(submits, pauses), max_size=12), speed=st.sampled_from([1.0, 8.0]))
def test_undisturbed_tasks_of_equal_priority_end_at_their_estimates(actions, speed):
    equal = [(name, a, 5 if name == "submit" else b) for name, a, b in actions]
    manager, witness = virtually(rehearse(LineRobot(speed=speed), equal))
    assert witness.check_succeeded() == sum(name == "submit" for name, *_ in actions)
    assert not any(task.changes for task in manager.repository.ended())


@settings(max_examples=examples(150))
@given(
    actions=st.lists(st.one_of(submits, submits, meddling, refusals, pauses), max_size=30),
    speed=st.sampled_from([1.0, 8.0]),
    slowness=st.sampled_from([1.0, 1.7, 0.6]),
)
def test_accepted_estimate_plus_changes_is_the_end(actions, speed, slowness):
    manager, witness = virtually(rehearse(LineRobot(speed=speed, slowness=slowness), actions))
    witness.check_succeeded()
    assert not manager._estimated_queue._accepted, "an estimate outlived its task"


@settings(max_examples=10)
@given(
    actions=st.lists(
        st.one_of(
            st.tuples(st.just("submit"), st.integers(1, 3), st.integers(1, 10)), meddling, pauses
        ),
        max_size=12,
    )
)
def test_estimates_of_the_kinematic_robot_add_up(actions):
    robot = KinematicRobot(default_world(), speed=4.0)
    robot_actions = [(name, f"{a},2" if name == "submit" else a, b) for name, a, b in actions]
    _, witness = virtually(rehearse(robot, robot_actions))
    witness.check_succeeded()


async def test_causes_of_changes_are_sentences_for_users():
    robot = LineRobot()
    manager = TaskManager(robot, MemoryStore(), TaskSettings(settle=0.5))
    await manager.start()
    await manager.submit("move", "10", 5)
    await manager.submit("move", "0", 5)
    await manager.submit("move", "4", 3)
    late = (await manager.submit("move", "10", 2)).task_id
    await asyncio.sleep(1)
    await manager.submit("move", "20", 7)
    await manager.cancel(2)
    await manager.reprioritise(late, 4)
    await manager.pause()
    await asyncio.sleep(4)
    await manager.resume()
    await until(lambda: manager.running and manager.running.task_id == 5)
    await asyncio.sleep(1)
    robot.slowness = 2.0
    await until(lambda: manager.running and manager.running.task_id == late)
    await asyncio.sleep(1)
    robot.slowness = 1.0
    await until(lambda: manager.repository.find(late).state.is_ended)
    assert [change.cause for change in manager.repository.find(late).changes] == [
        "task 5, priority 7, went ahead",
        "task 2 was cancelled",
        "it was moved to priority 4",
        "the queue was paused",
        "task 5 took longer than planned",
        f"task {late} took longer than planned",
    ]
    await manager.close()


async def test_current_estimate_agrees_with_accepted_estimate_and_changes():
    """What is shown at any time is the promise, plus the changes so far, less the time passed."""
    robot = LineRobot()
    manager = TaskManager(robot, MemoryStore())
    await manager.start()
    for target in ("3", "9", "1"):
        await manager.submit("move", target, 5)
    loop = asyncio.get_running_loop()
    accepted = manager.repository.find(3).accepted_estimate
    await asyncio.sleep(2)
    await manager.pause()
    for _ in range(5):
        await asyncio.sleep(1.5)
        manager.update_estimates()
        said = accepted + sum(c.seconds for c in manager.changes(manager.repository.find(3)))
        assert manager.estimate(3) == pytest.approx(said - loop.time(), abs=0.01)
    await manager.close()


async def test_an_estimate_is_never_negative():
    manager = TaskManager(LineRobot(), MemoryStore())
    await manager.start()
    await manager.submit("move", "3", 5)
    await until(lambda: manager.running)
    queue = manager._estimated_queue
    now = asyncio.get_running_loop().time()
    queue.set_free_at(now, lambda: "")
    assert queue.estimate(1, now + 1e-5) == 0.0
    assert queue.estimate(1, now - 1.0) == 1.0
    await manager.close()


async def test_so_many_changes_that_some_are_forgotten_still_add_up():
    robot = LineRobot()
    manager = TaskManager(robot, MemoryStore())
    await manager.start()
    await manager.submit("move", "100", 5)
    await asyncio.sleep(1)
    first = await manager.submit("move", "5", 5)
    accepted_at = asyncio.get_running_loop().time()
    for number in range(3, 2_600):
        await manager.submit("move", str(number % 7), 6)
        await manager.cancel(number)
    await manager.submit("move", "50", 6)
    changes = manager.changes(manager.repository.find(2))
    assert changes[0].cause.endswith("earlier changes")
    assert len(changes) <= 101
    await until(lambda: manager.repository.find(2).state.is_ended)
    took = asyncio.get_running_loop().time() - accepted_at
    total = sum(change.seconds for change in manager.repository.find(2).changes)
    assert first.estimated_time + total == pytest.approx(took, rel=0.01)
    await manager.close()


async def test_resumed_estimate_adds_up_after_changes_are_forgotten():
    wall, store = 1000.0, MemoryStore()
    old = TaskManager(LineRobot(), store, TaskSettings(wall_clock=lambda: wall))
    await old.start()
    await old.submit("move", "50", 5)
    await asyncio.sleep(5)
    promised = (
        await old.submit("move", "5", 5)
    ).estimated_time  # after task 1, which is not resumed
    await old.pause()
    await old.close()
    wall += 30.0
    manager = TaskManager(LineRobot(), store, TaskSettings(wall_clock=lambda: wall))
    await manager.start()
    loop = asyncio.get_running_loop()
    restarted_at = loop.time()
    await asyncio.sleep(2)
    for number in range(3, 2_300):
        await manager.submit("move", "7", 6)
        await manager.cancel(number)
    manager.update_estimates()
    task = manager.repository.find(2)
    changes = manager.changes(task)
    assert changes[0].cause.endswith("earlier changes")
    passed = 30.0 + loop.time() - restarted_at
    said = promised + sum(change.seconds for change in changes)
    assert said == pytest.approx(passed + manager.estimate(2), abs=0.01)
    await manager.close()


async def test_cancel_that_is_refused_late_delays_only_its_own_task():
    """Another task went ahead meanwhile; accepted estimate and changes still add up."""
    manager = TaskManager(LineRobot(), StubbornStore())
    await manager.start()
    await manager.pause()
    for target in ("3", "9", "1"):
        await manager.submit("move", target, 5)
    began = asyncio.get_running_loop().time()
    manager.repository._store.stubborn = 2
    refused = asyncio.ensure_future(manager.cancel(2))
    await asyncio.sleep(0.5)
    await manager.submit("move", "20", 9)
    with pytest.raises(StoreError):
        await refused
    await asyncio.sleep(1)
    manager.update_estimates()
    passed = asyncio.get_running_loop().time() - began
    for number in (1, 2, 3):
        task = manager.repository.find(number)
        said = task.accepted_estimate + sum(change.seconds for change in manager.changes(task))
        assert said == pytest.approx(passed + manager.estimate(number), abs=0.01), number
    await manager.close()
