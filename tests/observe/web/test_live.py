"""The events of the live page say what the services say, and say why tasks move."""

import asyncio
import json

import pytest

from taskrpc.observe.web import live
from taskrpc.observe.web.calls import CallLog
from taskrpc.observe.web.live import Live, LiveTasks, whole_task_json
from taskrpc.observe.web.streams import LiveStream
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.fleet import FleetManager, FleetSettings, MemoryFleet, MemoryFleetStore
from taskrpc.robot.tasks import MemoryStore, page_events
from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from tests.observe.web.test_streams import Connection, read
from tests.robot.tasks.fakes import LineRobot

NOON = 1_000_000.0


def wall_clock():
    return NOON + asyncio.get_running_loop().time()


def made_manager(robot=None, **settings):
    settings = TaskSettings(wall_clock=wall_clock, **settings)
    return TaskManager(robot or LineRobot(), MemoryStore(), settings)


@pytest.fixture
async def manager():
    made = made_manager()
    await made.start()
    yield made
    await made.close()


@pytest.fixture
async def driving():
    """A manager of the simulated robot."""
    made = made_manager(KinematicRobot(default_world()))
    await made.start()
    yield made
    await made.close()


def events(tasks):
    now = asyncio.get_running_loop().time()
    return {each.name: json.loads(each.json) for each in tasks.events(now, NOON + now)}


async def test_first_events_show_an_empty_queue_and_the_robot(manager):
    found = events(LiveTasks(manager))
    assert set(found) == {"tasks", "robot", "path"}
    assert found["tasks"]["running"] is None
    assert found["tasks"]["queue"] == found["tasks"]["ended"] == found["tasks"]["moves"] == []
    assert found["robot"]["battery"] is None
    assert found["path"] == {"task_id": None, "points": []}


async def test_nothing_is_sent_while_nothing_changes(manager):
    tasks = LiveTasks(manager)
    events(tasks)
    await asyncio.sleep(60)
    assert events(tasks) == {}


async def test_tasks_are_shown_in_run_order_with_estimates(manager):
    tasks = LiveTasks(manager)
    for target, priority in (("1", 5), ("2", 1), ("3", 9), ("4", 5)):
        await manager.submit("move", target, priority, client="ada")
    await asyncio.sleep(1)
    shown = events(tasks)["tasks"]
    assert shown["running"]["task_id"] == 3
    assert [task["task_id"] for task in shown["queue"]] == [1, 4, 2]
    assert [task["client"] for task in shown["queue"]] == ["ada"] * 3
    for task in (shown["running"], *shown["queue"]):
        assert task["estimated_time"] == pytest.approx(manager.estimate(task["task_id"]), abs=1e-3)
    assert shown["queued"] == 3
    assert shown["more"] == 0
    assert shown["revision"] == manager.change_feed.revision


async def test_long_lists_are_cut_and_the_rest_is_counted(manager):
    for number in range(3 * page_events.MAX_QUEUE):
        await manager.submit("move", str(number % 7), 5)
    await asyncio.sleep(0.5)
    shown = events(LiveTasks(manager))["tasks"]
    assert len(shown["queue"]) == page_events.MAX_QUEUE
    assert shown["queued"] == page_events.MAX_QUEUE + shown["more"] == 3 * page_events.MAX_QUEUE - 1


async def test_ended_tasks_are_shown_newest_first_and_counted(manager):
    for _ in range(page_events.MAX_ENDED + 5):
        await manager.submit("move", "0", 5)
    await manager.cancel(3)
    await asyncio.sleep(500)
    shown = events(LiveTasks(manager))["tasks"]
    assert shown["counts"] == {"SUCCEEDED": page_events.MAX_ENDED + 4, "CANCELED": 1}
    ends = [task["ended"] for task in shown["ended"]]
    assert len(ends) == page_events.MAX_ENDED
    assert ends == sorted(ends, reverse=True)


async def test_task_that_goes_ahead_is_named_as_the_cause_of_a_move(manager):
    tasks = LiveTasks(manager)
    for target in ("1", "2", "3"):
        await manager.submit("move", target, 5)
    await asyncio.sleep(0.5)
    assert events(tasks)["tasks"]["moves"] == []
    before = manager.estimate(2)
    await manager.submit("move", "2", 10)
    shown = events(tasks)["tasks"]
    moves = {move["task_id"]: move for move in shown["moves"]}
    assert set(moves) == {2, 3}  # neither the running task nor the one that went ahead
    assert moves[2]["cause"] == "task 4, priority 10, went ahead"
    assert moves[2]["seconds"] == pytest.approx(manager.estimate(2) - before, abs=0.01)
    assert moves[2]["t"] == pytest.approx(wall_clock())
    assert [each["task_id"] for each in shown["moves"]] == [2, 3]


async def test_reprioritised_task_moves_by_the_seconds_of_its_estimate(manager):
    tasks = LiveTasks(manager)
    for target in ("1", "2", "3"):
        await manager.submit("move", target, 5)
    await asyncio.sleep(0.5)
    events(tasks)
    before = {task_id: manager.estimate(task_id) for task_id in (2, 3)}
    await manager.reprioritise(3, 9)
    moves = {each["task_id"]: each for each in events(tasks)["tasks"]["moves"]}
    assert moves[3]["cause"] == "it was moved to priority 9"
    assert moves[2]["cause"] == "task 3 was moved to priority 9"
    for task_id, estimate in before.items():
        moved = manager.estimate(task_id) - estimate
        assert moves[task_id]["seconds"] == pytest.approx(moved, abs=0.01)


async def test_moves_are_bounded_and_an_old_delay_is_shown_once(manager):
    tasks = LiveTasks(manager)
    for _ in range(page_events.MAX_QUEUE):
        await manager.submit("move", "1", 5)
    await asyncio.sleep(0.5)
    events(tasks)
    await manager.submit("move", "1", 10)
    shown = events(tasks)["tasks"]
    assert len(shown["moves"]) == page_events.MAX_MOVES
    await manager.pause()
    assert events(tasks)["tasks"]["moves"] == shown["moves"]


async def test_progress_alone_is_sent_at_most_twice_a_second(driving):
    tasks = LiveTasks(driving)
    await driving.submit("move", "warehouse", 5)
    await asyncio.sleep(0.5)
    events(tasks)
    sent = 0
    for _ in range(20):
        await asyncio.sleep(live.TICK)
        sent += "tasks" in events(tasks)
    assert 3 <= sent <= 4


async def test_moving_robot_is_sent_each_time_with_its_path(driving):
    tasks = LiveTasks(driving)
    await driving.submit("move", "warehouse", 5)
    await asyncio.sleep(0.5)
    first = events(tasks)
    assert first["path"]["task_id"] == 1
    assert first["path"]["points"][0] == [1.0, 1.0]
    assert first["path"]["points"][-1] == list(default_world().places["warehouse"])
    for _ in range(10):
        await asyncio.sleep(live.TICK)
        found = events(tasks)
        assert found["robot"]["moving"]
        assert "path" not in found
        assert found["robot"]["remaining"] == pytest.approx(driving.remaining(), abs=1e-3)
    assert found["robot"]["battery"] < 100.0
    assert found["robot"]["odometer"] > 0.0
    await asyncio.sleep(60)
    found = events(tasks)
    assert found["path"] == {"task_id": None, "points": []}
    assert found["robot"]["remaining"] == 0.0


async def test_newest_scan_is_sent_once_with_its_ranges(driving):
    tasks = LiveTasks(driving)
    await driving.submit("scan", "1.5,1.5", 5)
    await driving.submit("scan", "2,2", 5)
    await asyncio.sleep(60)
    scan = events(tasks)["scan"]
    result = json.loads(driving.repository.find(2).result)
    assert scan["task_id"] == 2
    assert scan["ranges"] == result["ranges"]
    assert (scan["x"], scan["y"]) == (2.0, 2.0)
    await driving.submit("move", "1,1", 5)
    assert "scan" not in events(tasks)


@pytest.mark.parametrize(
    "result", [{"ranges": "none"}, {"ranges": [1.0] * (page_events.MAX_RANGES + 1)}, {"ranges": []}]
)
async def test_result_that_is_no_scan_is_left_out(result):
    class Own(LineRobot):
        async def execute(self, task_type, target, report):
            await super().execute(task_type, target, report)
            return result

    manager = made_manager(Own())
    await manager.start()
    await manager.submit("scan", "1", 5)
    await asyncio.sleep(30)
    assert "scan" not in events(LiveTasks(manager))
    await manager.close()


async def test_optional_method_that_fails_is_logged_once_and_the_rest_is_shown(caplog):
    robot = LineRobot()
    robot.battery = lambda: 1 / 0
    robot.odometer = lambda: 12.345
    robot.planned_path = lambda: [(0, 0), (1, 2)]
    manager = made_manager(robot)
    await manager.start()
    tasks = LiveTasks(manager)
    for _ in range(3):
        await manager.submit("move", "1", 5)
        await asyncio.sleep(0.5)
        found = events(tasks)
    assert found["robot"]["battery"] is None
    assert found["robot"]["odometer"] == 12.35 or found["robot"]["odometer"] == 12.34
    assert manager.telemetry().path == ((0.0, 0.0), (1.0, 2.0))
    assert len([line for line in caplog.messages if "battery()" in line]) == 1
    await manager.close()


async def test_markup_in_a_target_stays_text():
    class Anywhere(LineRobot):
        def plan(self, task_type, target, start):
            return super().plan(task_type, "1", start)

    made = made_manager(Anywhere())
    await made.start()
    target = "</script><b>\n\nevent: ending\ndata: {}\n\n\u2028"
    await made.submit("move", target, 5)
    stream, connection = LiveStream(), Connection()
    Live(made, stream, dict)
    _, states = stream.open(connection)
    found = dict(read(states))
    [task] = found["tasks"]["queue"]
    assert task["target"] == target
    assert "ending" not in found
    stream.close("end")
    await asyncio.sleep(0)
    await made.close()


async def test_one_task_has_its_result_and_the_changes_of_its_estimate(manager):
    await manager.submit("move", "1", 5)
    await manager.submit("move", "2", 5)
    await asyncio.sleep(0.5)
    await manager.submit("move", "3", 9)
    waiting = json.loads(whole_task_json(manager, 2))
    assert waiting["result"] is None
    assert [each["cause"] for each in waiting["changes"]] == ["task 3, priority 9, went ahead"]
    await asyncio.sleep(60)
    ended = json.loads(whole_task_json(manager, 2))
    assert ended["result"] == {"x": 2.0}
    assert ended["state"] == "SUCCEEDED"
    assert whole_task_json(manager, 99) is None


async def test_page_gets_hello_states_and_changes(manager):
    stream, connection = LiveStream(), Connection()
    shown = Live(manager, stream, lambda: {"node": "/task_server"}, wall_clock=wall_clock)
    [(name, hello)] = read(shown.hello(control=True))
    assert name == "hello"
    assert hello["protocol"] == page_events.PROTOCOL
    assert hello["control"] is True
    assert hello["server"]["node"] == "/task_server"
    assert hello["server"]["speed"] == 1.0
    assert hello["map"] is None
    tab, states = stream.open(connection)
    assert {name for name, _ in read(states)} == {"tasks", "robot", "path"}
    await manager.submit("move", "5", 5)
    await asyncio.sleep(2)
    found = dict(read(connection.text))
    assert found["tasks"]["running"]["task_id"] == 1
    tab.close()
    await asyncio.sleep(60)
    before = len(connection.written)
    await asyncio.sleep(60)
    assert len(connection.written) == before


async def test_students_are_shown_when_they_change(manager):
    stream, connection = LiveStream(), Connection()
    students = [{"name": "ada", "last_seen": None, "calls": 0, "connected": False}]
    Live(manager, stream, dict, students=lambda: students)
    tab, _ = stream.open(connection)
    await asyncio.sleep(5)
    assert [event for event in read(connection.text) if event[0] == "class"] == [
        ("class", {"students": students, "more": 0})
    ]
    students = [{"name": f"s{number}"} for number in range(500)]
    await asyncio.sleep(2)
    found = dict(read(connection.text))["class"]
    assert len(found["students"]) + found["more"] == 500
    assert len(found["students"]) == 200
    tab.close()


async def test_failure_of_one_part_is_logged_and_the_page_goes_on(manager, caplog):
    stream, connection = LiveStream(), Connection()
    Live(manager, stream, dict, students=lambda: 1 / 0)
    tab, _ = stream.open(connection)
    await manager.submit("move", "5", 5)
    await asyncio.sleep(5)
    assert dict(read(connection.text))["tasks"]["running"]["task_id"] == 1
    assert "the live page cannot show the nodes" in caplog.text
    assert caplog.text.count("ZeroDivisionError: division") == 1
    tab.close()


async def test_each_first_page_gets_the_statistics_of_calls(manager):
    stream = LiveStream()
    Live(manager, stream, dict, calls=CallLog())
    for _ in range(2):
        tab, states = stream.open(Connection())
        assert dict(read(states))["calls"]["stats"]["total"] == 0
        tab.close()
        await asyncio.sleep(5)


async def test_page_of_a_fleet_shows_its_own_robot_and_the_tasks_of_all_robots():
    loop = asyncio.get_running_loop()
    database = MemoryFleet(lambda: NOON + loop.time())
    first, second = (
        FleetManager(LineRobot(), MemoryFleetStore(database), FleetSettings(name=name))
        for name in ("r1", "r2")
    )
    await first.start()
    await second.start()
    for _ in range(4):
        await first.submit("move", "30", 5)
    await asyncio.sleep(1)
    for manager, own, other in ((first, "r1", "r2"), (second, "r2", "r1")):
        shown = events(LiveTasks(manager))["tasks"]
        assert shown["running"]["robot"] == own
        assert [task["state"] for task in shown["queue"]] == ["RUNNING", "QUEUED", "QUEUED"]
        assert shown["queue"][0]["robot"] == other
        assert {task["robot"] for task in shown["queue"][1:]} == {"r1", "r2"}
        assert (shown["queued"], shown["more"]) == (2, 0)
    await first.close()
    await second.close()
