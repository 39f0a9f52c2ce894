import asyncio
import contextlib
import time
from collections import Counter
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.observe.web.live import LiveTasks
from taskrpc.robot import Box, KinematicRobot, TargetError, World, default_world
from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.manager import FleetManager, FleetSettings
from taskrpc.robot.fleet.store import MemoryFleet, MemoryFleetStore
from taskrpc.robot.tasks.services.pages import page
from tests.properties import examples
from tests.robot.fleet.fakes import Fleet
from tests.robot.tasks.fakes import LineRobot


async def submitted(manager, *targets, priority=5, kind="move"):
    return [(await manager.submit(kind, str(each), priority)).task_id for each in targets]


async def test_tasks_of_any_server_are_shared_by_all_robots(fleet):
    managers = [await fleet.add(f"r{number}") for number in (1, 2, 3)]
    for index, target in enumerate([0, 3, 6, 9, 12, 15]):
        assert (await managers[index % 3].submit("move", str(target), 5)).success
    await fleet.until_done()
    assert set(fleet.states().values()) == {"SUCCEEDED"}
    assert all(robot.runs for robot in fleet.robots.values())
    assert sum(len(robot.runs) for robot in fleet.robots.values()) == 6


async def test_estimates_cover_the_fleet_and_come_true(fleet):
    managers = [await fleet.add(f"r{number}") for number in (1, 2)]
    estimates = {}
    for target in (4, 4, 8, 0):
        response = await managers[0].submit("move", str(target), 5)
        estimates[response.task_id] = response.estimated_time
    assert list(estimates.values()) == [6.0, 6.0, 11.0, 13.0]
    await fleet.until_done()
    for number, task in fleet.tasks().items():
        took = task.ended_at - task.submitted_at
        assert took == pytest.approx(estimates[number], abs=0.1)


async def test_preview_is_the_response_that_the_next_task_gets(fleet):
    managers = [await fleet.add(f"r{number}") for number in (1, 2)]
    for target, priority in [(4, 5), (4, 5), (8, 9), (0, 1), (2, 10)]:
        expected = managers[0].preview("move", str(target), priority)
        response = await managers[0].submit("move", str(target), priority)
        assert expected.estimated_time == pytest.approx(response.estimated_time, abs=0.01)
        assert (expected.success, expected.task_id) == (True, -1)
    refused = "move", "mars", 5
    assert managers[1].preview(*refused) == await managers[1].submit(*refused)


async def test_higher_priority_runs_first_whichever_server_accepted_it(fleet):
    first, second = [await fleet.add(f"r{number}", settle=0.1) for number in (1, 2)]
    await submitted(first, 1, 1, 1, priority=2)
    await submitted(second, 1, 1, priority=9)
    await fleet.until_done()
    order = sorted(fleet.tasks().values(), key=lambda task: (task.started_at, -task.priority))
    assert [task.priority for task in order] == [9, 9, 2, 2, 2]


async def test_place_goes_to_the_robot_that_reaches_it(fleet):
    first = await fleet.add("r1", capabilities="move:1,move:2")
    await fleet.add("r2", capabilities="move:7")
    await submitted(first, 7, 1, 7)
    await fleet.until_done()
    assert {t.target: t.robot for t in fleet.tasks().values()} == {"7": "r2", "1": "r1"}
    refused = await first.submit("move", "9", 5)
    assert refused.message == (
        "Invalid target: no robot of the fleet is able to execute move at 9."
        " r1: move, scan or report, limited to move:1,move:2;"
        " r2: move, scan or report, limited to move:7"
    )


async def test_server_accepts_tasks_again_before_it_has_renewed_its_lease(fleet):
    managers = [await fleet.add(name) for name in ("r1", "r2")]
    for name in ("r1", "r2"):
        fleet.cut_off(name)
    await asyncio.sleep(10.0)  # the leases end while the database is away
    assert not managers[0].lease.is_valid
    fleet.cut_off("r1", False)
    response = await managers[0].submit("move", "1", 5)
    assert response.success, response.message
    await fleet.until_done()
    assert fleet.states() == {1: "SUCCEEDED"}


async def test_misspelled_capabilities_are_reported(caplog):
    store = MemoryFleetStore(MemoryFleet(lambda: 0.0))
    FleetManager(LineRobot(), store, FleetSettings(capabilities="mov,scan:1,scna:1"))
    assert "the capabilities mov and scna:1 allow nothing: this robot does" in caplog.text


async def test_task_of_a_server_that_is_cut_off_is_interrupted_and_the_others_go_on(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 30, 30, 30)
    await asyncio.sleep(2)
    fleet.cut_off("r1")
    await fleet.until(lambda: "INTERRUPTED" in fleet.states().values(), 10)
    [run] = fleet.robots["r1"].runs
    interrupted = next(t for t in fleet.tasks().values() if t.state.value == "INTERRUPTED")
    assert 1000.0 + run[2] < interrupted.ended_at  # it stood before the others took notice
    await fleet.until(lambda: list(fleet.states().values()).count("SUCCEEDED") == 2)
    assert len(fleet.robots["r2"].runs) == 2
    assert second.lease.is_valid


async def test_server_that_comes_back_executes_tasks_again(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 30)
    await asyncio.sleep(1)
    fleet.cut_off("r1")
    await asyncio.sleep(15)
    fleet.cut_off("r1", False)
    await asyncio.sleep(5)
    assert first.lease.is_valid
    await submitted(second, 30, 30)
    await fleet.until(lambda: list(fleet.states().values()).count("SUCCEEDED") == 2)
    assert len(fleet.robots["r1"].runs) > 1


async def test_lost_notifications_delay_a_task_by_a_second_at_most(fleet):
    first, second = [
        await fleet.add(f"r{number}", capabilities=c)
        for number, c in (("1", "scan"), ("2", "move"))
    ]
    second.store.gets_notifications = False
    polling = asyncio.create_task(_poll(second.store))
    await submitted(first, 3)
    await fleet.until_done(10)
    assert fleet.robots["r2"].runs[0][1] < 2.5
    polling.cancel()


async def _poll(store):
    while True:
        await asyncio.sleep(1)
        store.notified()


async def test_claim_without_an_answer_is_executed_once(fleet):
    manager = await fleet.add("r1", settle=0.5)
    await submitted(manager, 3)
    manager.store.loses_commit = True
    await fleet.until_done(30)
    assert [target for target, *_ in fleet.robots["r1"].runs] == ["3"]


async def test_end_without_an_answer_is_stored_once(fleet):
    manager = await fleet.add("r1")
    await submitted(manager, 3)
    await asyncio.sleep(4.5)
    manager.store.loses_commit = True
    await fleet.until_done(30)
    assert fleet.states() == {1: "SUCCEEDED"}
    assert len(fleet.robots["r1"].runs) == 1


async def test_submission_without_an_answer_is_of_unknown_outcome(fleet):
    manager = await fleet.add("r1")
    manager.store.loses_commit = True
    with pytest.raises(OutcomeUnknown):
        await manager.submit("move", "1", 5)
    manager.store.is_cut_off = True
    with pytest.raises(StoreError):
        await manager.submit("move", "1", 5)


async def test_cancel_reaches_the_robot_of_another_server(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 30)
    await asyncio.sleep(2)
    other = second if fleet.tasks()[1].robot == "r1" else first
    response = await other.cancel(1, client="ann")
    assert response.message == "Task 1 was cancelled"
    assert fleet.tasks()[1].message == "cancelled by ann"
    own = first if other is second else second
    await submitted(first, 30)
    await asyncio.sleep(2)
    runner = fleet.managers[fleet.tasks()[2].robot]
    assert (await runner.cancel(2)).message == "Task 2 was cancelled"
    assert own.running is None


@pytest.mark.parametrize("executing", [0, 1], ids=["own robot", "robot of another server"])
@pytest.mark.parametrize("verb", ["cancelled", "stopped"])
async def test_ended_task_has_the_decisions_of_all_servers(fleet, verb, executing):
    managers = [await fleet.add(f"r{number}") for number in (1, 2)]
    await managers[0].pause()
    [task_id] = await submitted(managers[0], 20)
    await managers[1].reprioritise(task_id, 8, client="ann")
    await managers[1 - executing].pause(robot=managers[1 - executing].name)
    await managers[0].resume()
    await asyncio.sleep(2)
    assert fleet.tasks()[task_id].robot == managers[executing].name
    if verb == "stopped":
        await managers[0].stop(client="ben")
    else:
        await managers[0].cancel(task_id, client="ben")
    await fleet.until(lambda: fleet.tasks()[task_id].state.is_ended)
    decided = [(each.client, each.action) for each in fleet.tasks()[task_id].decisions]
    assert decided == [("ann", "moved to priority 8"), ("ben", verb)]


async def test_cancel_of_a_task_that_another_server_interrupts_meanwhile_is_refused(fleet):
    first = await fleet.add("r1", capabilities="move")
    second = await fleet.add("r2", capabilities="scan")
    fleet.robots["r1"].ignores_cancel = True
    await submitted(first, 0)
    await asyncio.sleep(0.5)
    first.store.gets_notifications = False

    async def interrupt():
        await asyncio.sleep(0.1)
        epoch = first.lease.epoch
        await second.store.transact(lambda state, now: rules.leave(state, now, "r1", epoch))

    response, _ = await asyncio.gather(first.cancel(1), interrupt())
    assert response.message == "Task 1 is INTERRUPTED: cannot be cancelled any more"
    assert fleet.states() == {1: "INTERRUPTED"}


async def test_pause_and_resume_concern_all_robots(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 20, 20, 20)
    await asyncio.sleep(1)
    await second.pause()
    await asyncio.sleep(1)
    assert sorted(fleet.states().values()) == ["PAUSED", "PAUSED", "QUEUED"]
    await asyncio.sleep(60)
    assert first.is_paused
    await first.resume()
    await fleet.until_done()
    assert set(fleet.states().values()) == {"SUCCEEDED"}


async def test_pause_of_one_robot_at_any_server_halts_only_this_one(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 20, 20, 20)
    await asyncio.sleep(1)
    assert (await second.pause(robot="r1")).message == "r1 is paused; the other robots continue"
    await asyncio.sleep(60)
    assert (first.running.state.value, first.is_paused) == ("PAUSED", False)
    assert sorted(fleet.states().values()) == ["PAUSED", "SUCCEEDED", "SUCCEEDED"]
    resumed = await second.resume()
    assert resumed.message == (
        "The queue is resumed; still paused by name: r1 (taskrpc task resume --robot r1)"
    )
    await asyncio.sleep(5)
    assert first.running.state.value == "PAUSED"
    await second.resume(robot="r1")
    await fleet.until_done()
    assert set(fleet.states().values()) == {"SUCCEEDED"}


async def test_stop_of_one_robot_at_any_server_cancels_only_its_task(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 20, 20, 20)
    await asyncio.sleep(1)
    response = await second.stop(robot="r1", client="ann")
    [canceled] = [task for task in fleet.tasks().values() if task.state.value == "CANCELED"]
    number = canceled.task_id
    assert response.message == (
        "r1 is stopped and paused; the other robots continue;"
        f" task {number} was cancelled (taskrpc task requeue {number} runs it again)"
    )
    assert (canceled.robot, canceled.message) == ("r1", "r1 was stopped by ann")
    assert (await second.stop(robot="r2")).success
    await asyncio.sleep(5)
    assert list(fleet.states().values()).count("QUEUED") == 1
    assert not second.is_paused
    await second.resume(robot="r1")
    await fleet.until_done()
    assert list(fleet.states().values()).count("SUCCEEDED") == 1


async def test_own_robot_is_paused_by_name_while_the_database_is_away_and_another_is_not(fleet):
    first, _ = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 20, 20)
    await asyncio.sleep(1)
    fleet.cut_off("r1")
    assert (await first.pause(robot="r1")).message.startswith("Only r1 is paused, but this could")
    with pytest.raises(StoreError):
        await first.pause(robot="r2")
    with pytest.raises(StoreError):
        await first.stop(robot="r2")
    fleet.cut_off("r1", False)
    assert first.is_paused
    await first.resume(robot="r1")
    assert not first.is_paused


async def test_servers_know_where_every_robot_is(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 20)
    await asyncio.sleep(5)
    driving, idle = sorted(second.robots(), key=lambda robot: not robot.task_id)
    assert 0 < driving.pose.x < 20
    assert (driving.state, driving.task_id, idle.state) == ("running", 1, "idle")
    assert [each.name for each in (driving, idle) if each.is_own] == ["r2"]
    await first.pause(robot=driving.name)
    await asyncio.sleep(1)
    assert [each.state for each in second.robots() if each.name == driving.name] == ["paused"]
    await fleet.managers.pop("r1").close()
    await asyncio.sleep(0.1)
    assert {each.name: each.state for each in second.robots()}["r1"] == "away"


async def test_live_page_gets_the_robots_when_they_change(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    live = LiveTasks(first)
    await asyncio.sleep(0.1)

    def robots():
        found = {each.name: msgspec.json.decode(each.json) for each in live.events(0.0, 0.0)}
        return found.get("fleet", {}).get("robots")

    assert [(each["name"], each["state"], each["own"]) for each in robots()] == [
        ("r1", "idle", True),
        ("r2", "idle", False),
    ]
    assert robots() is None
    await submitted(second, 20)
    await asyncio.sleep(0.5)
    [running] = [each for each in robots() if each["state"] == "running"]
    assert (running["task_id"], running["what"]) == (1, "move 20")


async def test_stop_halts_all_robots_and_pauses_the_queue(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 20, 20, 20)
    await asyncio.sleep(1)
    own, other = second.running.task_id, first.running.task_id
    response = await second.stop(client="ann")
    assert response.message == (
        "The robots are stopped and the queue is paused;"
        f" task {own} was cancelled (taskrpc task requeue {own} runs it again);"
        f" task {other} is being cancelled"
    )
    await asyncio.sleep(2)
    assert sorted(fleet.states().values()) == ["CANCELED", "CANCELED", "QUEUED"]
    assert first.is_paused


async def test_server_that_ends_leaves_its_task_interrupted_at_once(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 30, 30)
    await asyncio.sleep(2)
    await first.close()
    assert sorted(fleet.states().values()) == ["INTERRUPTED", "RUNNING"]
    del fleet.managers["r1"]
    [interrupted] = (n for n, state in fleet.states().items() if state == "INTERRUPTED")
    assert (await second.requeue(interrupted, resume=True)).success
    await fleet.until_done()
    assert len(fleet.robots["r2"].runs) == 2


async def test_list_has_the_running_tasks_of_all_robots_first(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    await submitted(first, 30, 30, 30, 30)
    await asyncio.sleep(1)
    rows = page(second, "").rows
    assert [(row.task.task_id, row.task.state.value) for row in rows] == [
        (1, "RUNNING"),
        (2, "RUNNING"),
        (3, "QUEUED"),
        (4, "QUEUED"),
    ]
    assert second.planned_robot(rows[2].task) in ("r1", "r2")
    assert all(row.estimated_time > 0 for row in rows)
    paged, cursor = [], ""
    while True:
        part = page(second, cursor, limit=1)
        paged += [row.task.task_id for row in part.rows]
        cursor = part.next_page
        if not cursor:
            break
    assert paged == [1, 2, 3, 4]


async def test_watchers_of_every_server_hear_of_changes(fleet):
    first, second = [await fleet.add(f"r{number}") for number in (1, 2)]
    before = second.change_feed.revision
    await submitted(first, 5)
    await asyncio.sleep(0.1)
    assert second.change_feed.changed_since(before) == [1]


async def test_place_of_another_robots_map_is_accepted_by_every_server(fleet):
    upstairs = World((6.0, 6.0), dock=(1.0, 1.0), places={"attic": (5.0, 5.0)})
    downstairs = World((6.0, 6.0), dock=(1.0, 1.0), places={"cellar": (5.0, 5.0)})
    first = await fleet.add("r1", KinematicRobot(upstairs))
    await fleet.add("r2", KinematicRobot(downstairs))
    for place in ("cellar", "attic", "3,3"):
        assert (await first.submit("move", place, 5)).success
    refused = await first.submit("move", "Celar", 5)
    assert refused.message == (
        "Invalid target: no robot of the fleet is able to execute move at Celar"
        " (did you mean cellar?)."
        " r1: move, scan or report at attic, dock or x,y up to 6,6;"
        " r2: move, scan or report at cellar, dock or x,y up to 6,6"
    )
    await fleet.until_done()
    robots = {task.target: task.robot for task in fleet.tasks().values()}
    assert (robots["cellar"], robots["attic"]) == ("r2", "r1")
    assert set(fleet.states().values()) == {"SUCCEEDED"}


async def test_coordinates_that_only_another_robots_map_has_are_accepted_by_every_server(fleet):
    first = await fleet.add("r1", KinematicRobot(World((6.0, 6.0), dock=(1.0, 1.0))))
    wall = Box.rectangle((14.0, 1.0), (2.0, 2.0))
    large = World((20.0, 6.0), dock=(1.0, 1.0), obstacles=[wall])
    await fleet.add("r2", KinematicRobot(large))
    free, blocked = await submitted(first, "19,5", "15,2")
    refused = await first.submit("move", "25,5", 5)
    assert "r2: move, scan or report at dock or x,y up to 20,6" in refused.message
    await fleet.until_done()
    assert fleet.tasks()[free].robot == "r2"
    assert fleet.tasks()[free].state.value == "SUCCEEDED"
    assert fleet.tasks()[blocked].state.value == "FAILED"
    assert "the robot cannot stand at '15,2'" in fleet.tasks()[blocked].message


async def test_target_that_the_capabilities_of_another_robot_name_is_accepted(fleet):
    first = await fleet.add("r1", KinematicRobot(default_world()))
    await fleet.add("r2", Shelves(), capabilities="move:shelf_*")
    assert (await first.submit("move", "shelf_3", 5)).success
    (wrong,) = await submitted(first, "shelf_99")
    await fleet.until_done()
    assert fleet.tasks()[1].robot == "r2"
    assert fleet.tasks()[wrong].message == "expected shelf_1 to shelf_9, got 'shelf_99'"


class Shelves(LineRobot):
    """A robot of the user's own that tells the fleet nothing about its targets."""

    def plan(self, task_type, target, start):
        name, _, number = target.partition("_")
        if name != "shelf" or len(number) != 1:
            raise TargetError(f"expected shelf_1 to shelf_9, got {target!r}")
        return super().plan(task_type, number, start)


async def test_task_for_a_robot_that_is_away_waits_for_it(fleet):
    attic = World((6.0, 6.0), dock=(1.0, 1.0), places={"attic": (5.0, 5.0)})
    first = await fleet.add("r1", KinematicRobot(default_world()))
    await fleet.add("r2", KinematicRobot(attic))
    await fleet.managers.pop("r2").close()
    response = await first.submit("move", "attic", 5)
    assert response.message == "Task queued: move (waits for r2, which is away)"
    await asyncio.sleep(60)
    assert first.waits_for(fleet.tasks()[1]) == "waits for r2, which is away"
    await fleet.add("r2", KinematicRobot(attic))
    await fleet.until_done()
    assert fleet.tasks()[1].robot == "r2"
    assert first.waits_for(fleet.tasks()[1]) == ""


async def test_simulated_robots_tell_which_places_they_reach():
    loop = asyncio.get_running_loop()
    robot = KinematicRobot(default_world())
    manager = FleetManager(robot, MemoryFleetStore(MemoryFleet(loop.time)))
    await manager.start()
    assert "warehouse" in manager.store.state.robots["robot_1"].places
    await manager.close()


def test_wrong_capabilities_are_refused():
    store = MemoryFleetStore(MemoryFleet(lambda: 1.0))
    with pytest.raises(ValueError, match="expected a list"):
        FleetManager(LineRobot(), store, FleetSettings(capabilities="move,"))


NAMES = ("r1", "r2", "r3")
ACTIONS = ["submit", "submit", "partition", "cut off", "connect", "lose a commit", "restart"]
STEPS = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.3, 1.0, 4.0]), st.sampled_from(ACTIONS), st.sampled_from(NAMES)
    ),
    min_size=3,
    max_size=25,
)


class History:
    """What happens to a fleet, and what must hold afterwards."""

    def __init__(self, fleet):
        self.fleet = fleet
        self.accepted, self.in_doubt = set(), set()
        self.requeued = Counter()
        self.runs = []  # of servers that were restarted

    async def do(self, action, name):
        manager = self.fleet.managers[name]
        if action == "submit":
            number = len(self.accepted) + len(self.in_doubt)
            target = str((-1) ** number * (10 + number))  # far apart, so that drives take long
            try:
                response = await manager.submit("move", target, 5)
                if response.success:
                    self.accepted.add(target)
            except OutcomeUnknown:
                self.in_doubt.add(target)
            except StoreError:
                pass
        elif action == "restart":
            manager.store.is_cut_off = False
            await manager.close()
            self.runs += self.fleet.robots[name].runs
            await self.fleet.add(name)
        elif action == "partition":
            await self.partition(name)
        elif action == "lose a commit":
            manager.store.loses_commit = True
        else:
            self.fleet.cut_off(name, action == "cut off")

    async def partition(self, name):
        """Cut a server off until its lease has ended, and queue its task again meanwhile."""
        self.fleet.cut_off(name)
        for _ in range(9):
            await asyncio.sleep(1)
            for manager in self.fleet.managers.values():
                with contextlib.suppress(StoreError, OutcomeUnknown):
                    await self.requeue_interrupted(manager)
        self.fleet.cut_off(name, False)

    async def requeue_interrupted(self, manager):
        await manager.store.refresh()
        for number in list(manager.store.state.interrupted):
            self.requeued[self.fleet.tasks()[number].target] += 1
            await manager.requeue(number, resume=True)

    async def settle(self):
        """Connect everything, and decide about interrupted tasks as an operator would."""
        for manager in self.fleet.managers.values():
            manager.store.is_cut_off = manager.store.loses_commit = False
        manager = self.fleet.managers["r1"]
        for _ in range(50):
            await asyncio.sleep(10)
            await self.requeue_interrupted(manager)
            if set(self.fleet.states().values()) <= {"SUCCEEDED"}:
                return

    def check(self):
        tasks = self.fleet.tasks().values()
        stored = Counter(task.target for task in tasks)
        assert self.accepted <= set(stored) <= self.accepted | self.in_doubt
        assert all(count == 1 for count in stored.values())
        assert {task.state.value for task in tasks} <= {"SUCCEEDED"}
        runs = self.runs + [run for robot in self.fleet.robots.values() for run in robot.runs]
        for target, count in Counter(target for target, *_ in runs).items():
            assert count <= 1 + self.requeued[target], f"{target} ran {count} times"
        for target in stored:
            mine = sorted((begin, end) for each, begin, end in runs if each == target)
            assert all(first[1] <= second[0] for first, second in pairwise(mine))


@settings(max_examples=examples(40), deadline=None)
@given(steps=STEPS)
async def test_no_task_is_lost_or_runs_twice_whatever_happens_to_the_servers(steps):
    fleet = Fleet()
    for name in NAMES:
        await fleet.add(name)
    history = History(fleet)
    for seconds, action, name in steps:
        await asyncio.sleep(seconds)
        await history.do(action, name)
    await history.settle()
    history.check()
    await fleet.close()


@pytest.mark.parametrize("hours", [-7.0, 5.0])
async def test_clock_of_a_server_that_is_hours_wrong_changes_neither_lease_nor_times(
    fleet, monkeypatch, hours
):
    wall = time.time
    monkeypatch.setattr(time, "time", lambda: wall() + hours * 3600)
    first = await fleet.add("r1")
    monkeypatch.setattr(time, "time", wall)
    second = await fleet.add("r2")
    before = fleet.database.clock()
    await submitted(first, 5, 5)
    await asyncio.sleep(20)
    for task in fleet.tasks().values():
        assert task.state.value == "SUCCEEDED"
        assert before <= task.submitted_at <= task.started_at <= task.ended_at
        assert task.ended_at <= fleet.database.clock()
    assert first.lease.is_valid
    assert second.lease.is_valid
    assert {robot.state for robot in second.robots()} == {"idle"}
