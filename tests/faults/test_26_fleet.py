"""Promise 26: a fleet on PostgreSQL loses no task, and no task runs twice.

Real servers, a real PostgreSQL, `kill -9` of both, connections that break in the middle of a
commit, servers that are paused until their lease has ended, and lost notifications.
"""

import asyncio
import collections
import contextlib
import os
import random
import signal

import msgspec
import pytest

import srvgen
import taskrpc
from taskrpc.robot import default_world
from taskrpc.robot.fleet import FleetManager, FleetSettings, rules
from taskrpc.robot.fleet.worker import FleetWorker
from taskrpc.robot.tasks import rules as requests
from taskrpc.robot.tasks.model import TaskState
from tests.faults.harness import Bug
from tests.faults.postgres_proxy import CUT, SWALLOW, PostgresProxy
from tests.faults.programs import TASK_SERVER, kill
from tests.robot.tasks.fakes import LineRobot

pytest.importorskip("psycopg")

from taskrpc.robot.fleet.postgres.store import POLL, PostgresStore

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")


# Commits without an answer


def takes_an_unknown_commit_for_a_failure(patch):
    async def took_effect(store, uncertain, deadline):
        await store._disconnect()
        return False

    patch(PostgresStore, "_took_effect", took_effect)


@pytest.mark.planted(Bug(takes_an_unknown_commit_for_a_failure, breaks="stored twice"))
async def test_commit_without_an_answer_is_found_out(postgres_url, shared_cluster, counts, seed):
    chance = random.Random(seed)
    async with PostgresProxy(shared_cluster.port) as proxy:
        url = postgres_url.replace(f":{shared_cluster.port}/", f":{proxy.port}/")
        store = PostgresStore(url, listen=False)
        await store.refresh()
        for number in range(1, 13):
            fault = chance.choice([CUT, SWALLOW])
            proxy.arm(fault)

            def action(state, now, number=number):
                if state.meta.next_id <= number:
                    counts["actions"] += 1
                state.set_meta(next_id=state.meta.next_id + 1)
                return state.meta.next_id

            await store.transact(action)
            counts[fault] += not proxy.is_armed
            if store.state.meta.next_id != number + 1:
                counts["stored twice"] += 1
                break
        observer = PostgresStore(postgres_url, listen=False)
        stored = (await observer.load()).next_id
        counts["lost"] += stored <= number
        await observer.close()
        await store.close()
    counts.check("stored twice", "lost", happened=(CUT, SWALLOW))


# Lost notifications


def never_looks_by_itself(patch):
    patch(PostgresStore, "_poll", lambda store: None)


@pytest.mark.planted(Bug(never_looks_by_itself, breaks="never begun"))
async def test_lost_notification_delays_a_task_but_does_not_lose_it(
    postgres_url, counts, monkeypatch
):
    accepting = PostgresStore(postgres_url)

    async def no_notification(connection, revision):
        counts["notifications lost"] += 1

    monkeypatch.setattr(accepting, "_notify", no_notification)
    first = FleetManager(
        LineRobot(), accepting, FleetSettings(name="r1", capabilities="scan", settle=0.0)
    )
    driving = PostgresStore(postgres_url)
    second = FleetManager(
        LineRobot(speed=50.0), driving, FleetSettings(name="r2", settle=0.0, lease=60.0)
    )
    await second.start()
    await first.start()
    await asyncio.sleep(POLL + 0.5)
    for target in (1, 2, 3):
        await first.submit("move", str(target), 5)
        if not await _begins(second, 3 * POLL):
            counts["never begun"] += 1
            break
        counts["begun"] += 1
    await first.close()
    await second.close()
    counts.check("never begun", happened=("notifications lost", "begun"))


async def _begins(manager, seconds):
    """Whether the manager's robot begins a task in time, and then ends it."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            ran = len(manager.robot.log)
            while len(manager.robot.log) == ran or manager.running is not None:
                await asyncio.sleep(0.02)
            return True
    return False


# Real processes


class Rehearsal:
    """Servers of a fleet as processes, an observer of their database, and the robots' notebooks."""

    def __init__(self, url, folder, programs, counts):
        self.url, self.folder, self.programs, self.counts = url, folder, programs, counts
        self.servers = {}
        self.observer = PostgresStore(url, listen=False)
        self.requeued = collections.Counter()
        world = default_world()
        grid = ((x / 7, y / 7) for x in range(2, 70) for y in range(2, 70))
        free = [each for each in grid if each[0] < world.size[0] and world.is_free(each)]
        self.places = [f"{x:.4f},{y:.4f}" for x, y in free]

    async def start(self, name, *, speed=20, url=""):
        os.environ["NOTEBOOK"] = str(self.folder / f"notebook_{name}")
        self.servers[name] = await self.programs.start(
            TASK_SERVER,
            *(
                "--db",
                url or self.url,
                "--robot-name",
                name,
                "--log-level",
                "error",
                "--settle",
                "0",
            ),
            *("--robot", "tests.faults.notebook_robot:NotebookRobot", "--speed", str(speed)),
            ready="taskrpc-server ready",
            name=f"{name}.py",
        )

    def lines(self, name):
        path = self.folder / f"notebook_{name}"
        return path.read_text().split("\n")[:-1] if path.exists() else []

    def drives(self, name):
        """Whether a robot has begun a task that it has not ended."""
        return (self.lines(name) or [""])[-1].startswith("began")

    def begun(self):
        """How often each target was begun, by all robots."""
        return collections.Counter(
            line.removeprefix("began ")
            for path in self.folder.glob("notebook_*")
            for line in path.read_text().splitlines()
            if line.startswith("began ")
        )

    async def look_anew(self):
        """Forget what the observer knows: it does not hear of rows that are deleted."""
        await self.observer.close()
        self.observer = PostgresStore(self.url, listen=False)

    async def tasks(self):
        await self.observer.refresh()
        return self.observer.state.tasks

    async def until(self, condition, seconds=60):
        """Wait until a condition of the tasks holds; returns whether it did."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while True:
                    with contextlib.suppress(taskrpc.TaskRpcError):
                        if condition(await self.tasks()):
                            return True
                    await asyncio.sleep(0.05)
        return False

    async def hold(self, name, is_held=True):
        """Let a robot begin no task, or let it begin tasks again."""

        def action(state, now):
            state.put_robot(msgspec.structs.replace(state.robots[name], paused=is_held))

        await self.observer.transact(action)

    async def r1_begins_a_drive(self, **options):
        """Start r1 and r2, and let r1 begin to drive; returns the target.

        Both run before the drive begins: on a busy machine, a start takes longer than a drive.
        """
        await self.start("r1", speed=1, **options)
        await self.start("r2", speed=0.05)  # slow: its own drive must not end in the meantime
        await self.hold("r2")
        target = self.places[-1]
        async with taskrpc.Node("user") as node:
            client = node.create_client(RobotTask, "/robot_task", timeout=30)
            await client.call(RobotTask.Request(task_type="move", target=target, priority=5))
        assert await self.until(lambda tasks: self.lines("r1") == [f"began {target}"])
        return target

    async def r1_is_back(self):
        """Whether r1 has joined again after it lost its lease; waits for it."""
        return await self.until(
            lambda tasks: self.observer.state.robots["r1"].is_live(self.observer.now())
        )

    async def requeue_interrupted(self):
        """Decide as an operator would: queue the interrupted tasks again."""
        for number in list(self.observer.state.interrupted):
            target = self.observer.state.tasks[number].target
            self.requeued[target] += 1

            def action(state, now, number=number):
                task = state.tasks.get(number)
                decision = requests.requeue(
                    task, number, now, "", resume=True, refusal=lambda _: ""
                )
                rules.carry_out(state, now, decision, lambda task: 0.0)

            await self.observer.transact(action)

    def judge_runs(self):
        for target, count in self.begun().items():
            self.counts["run twice"] += count > 1 + self.requeued[target]


def runs_the_task_of_a_lost_lease_again(patch):
    def interrupt(state, now, robot, reason):
        task = state.tasks[robot.task_id]
        state.put_task(
            msgspec.structs.replace(task, state=TaskState.QUEUED, robot="", started_at=None)
        )

    patch(rules, "_interrupt", interrupt)


def stores_the_end_of_a_lost_lease(patch):
    def update(state, now, name, epoch, task, pose=None):
        state.put_task(task)

    patch(rules, "update", update)


@pytest.mark.planted(
    Bug(runs_the_task_of_a_lost_lease_again, breaks="run twice"),
    Bug(stores_the_end_of_a_lost_lease, breaks="overwritten"),
)
async def test_paused_server_does_not_disturb_those_that_took_over(
    postgres_url, tmp_path, programs, counts
):
    scene = Rehearsal(postgres_url, tmp_path, programs, counts)
    target = await scene.r1_begins_a_drive()
    scene.servers["r1"].send_signal(signal.SIGSTOP)
    counts["paused"] += 1
    await scene.hold("r2", False)
    assert await scene.until(
        lambda tasks: tasks[1].state is TaskState.INTERRUPTED or scene.begun()[target] > 1
    )
    await scene.requeue_interrupted()
    assert await scene.until(lambda tasks: tasks[1].robot == "r2")
    scene.servers["r1"].send_signal(signal.SIGCONT)
    # r1 joins again after it has tried to store the end of its task.
    counts["came back"] += await scene.r1_is_back()
    task = (await scene.tasks())[1]
    counts["overwritten"] += task.robot != "r2" or task.state.is_ended
    scene.judge_runs()
    await scene.observer.close()
    counts.check("run twice", "overwritten", happened=("paused", "came back"))


def never_halts_its_robot(patch):
    patch(FleetWorker, "lease_ended", lambda worker: None)


@pytest.mark.planted(Bug(never_halts_its_robot, breaks="driven without a lease"))
async def test_server_behind_a_black_hole_halts_its_robot_and_comes_back(
    postgres_url, shared_cluster, tmp_path, programs, counts
):
    scene = Rehearsal(postgres_url, tmp_path, programs, counts)
    async with PostgresProxy(shared_cluster.port) as proxy:
        url = postgres_url.replace(f":{shared_cluster.port}/", f":{proxy.port}/")
        far = await scene.r1_begins_a_drive(url=url)
        proxy.is_black_hole = True
        counts["partitions"] += 1
        await scene.hold("r2", False)
        assert await scene.until(lambda tasks: tasks[1].state is TaskState.INTERRUPTED)
        await scene.requeue_interrupted()
        assert await scene.until(lambda tasks: tasks[1].robot == "r2")
        await asyncio.sleep(10)  # the drive of r1 would have ended by now
        counts["driven without a lease"] += f"ended {far}" in scene.lines("r1")
        proxy.is_black_hole = False
        counts["came back"] += await scene.r1_is_back()
        scene.judge_runs()
        await scene.observer.close()
        for server in scene.servers.values():
            await kill(server)
    counts.check("run twice", "driven without a lease", happened=("partitions", "came back"))


def forgets_the_running_task(patch):
    patch(rules, "_interrupt", lambda state, now, robot, reason: state.forget_task(robot.task_id))


@pytest.mark.planted(Bug(forgets_the_running_task, breaks="lost"))
async def test_killed_servers_and_a_killed_postgres_lose_nothing(
    own_cluster, tmp_path, programs, counts, seed, large
):
    chance = random.Random(seed)
    own_cluster.execute("CREATE DATABASE fleet")
    scene = Rehearsal(own_cluster.url("fleet"), tmp_path, programs, counts)
    names = ("r1", "r2", "r3")
    for name in names:
        await scene.start(name, speed=8)
    wanted = chance.sample(scene.places, 300 if large else 40)
    retry = taskrpc.RetryPolicy(attempts=50, wait_initial=0.1)
    async with taskrpc.Node("user") as node:
        client = node.create_client(RobotTask, "/robot_task", timeout=60, retry=retry)

        async def submit(target):
            await asyncio.sleep(chance.uniform(0, 200 if large else 8))
            request = RobotTask.Request(
                task_type="move", target=target, priority=chance.randint(1, 10)
            )
            try:
                response = await client.call(request)
            except taskrpc.TaskRpcError:
                counts["submissions in doubt"] += 1
                return
            assert response.success, response.message
            acknowledged.add(target)

        acknowledged: set[str] = set()
        submitting = asyncio.gather(*(submit(target) for target in wanted))
        for round_ in range(20 if large else 2):
            await asyncio.sleep(chance.uniform(1.5, 3))
            name = chance.choice(names)
            await scene.until(lambda tasks, name=name: scene.drives(name), 10)
            await kill(scene.servers[name])
            counts["servers killed"] += 1
            if round_ % 2:
                own_cluster.kill()
                counts["postgres killed"] += 1
                await asyncio.sleep(chance.uniform(0, 1))
                await asyncio.to_thread(own_cluster.start)
            await scene.start(name, speed=8)
        await submitting

    deadline = asyncio.get_running_loop().time() + 120
    while asyncio.get_running_loop().time() < deadline:
        await scene.until(lambda tasks: all(task.state.is_ended for task in tasks.values()), 5)
        await scene.look_anew()
        await scene.tasks()
        await scene.requeue_interrupted()
        states = {task.state for task in (await scene.tasks()).values()}
        if states <= {TaskState.SUCCEEDED}:
            break
    tasks = await scene.tasks()
    stored = collections.Counter(task.target for task in tasks.values())
    counts["tasks"] += len(tasks)
    counts["lost"] += len(acknowledged - set(stored))
    counts["stored twice"] += sum(count > 1 for count in stored.values())
    counts["never ended"] += sum(task.state is not TaskState.SUCCEEDED for task in tasks.values())
    counts["interrupted"] += scene.requeued.total()
    scene.judge_runs()
    await scene.observer.close()
    promises = "lost", "stored twice", "never ended", "run twice"
    counts.check(*promises, happened=("servers killed", "postgres killed", "interrupted"))
