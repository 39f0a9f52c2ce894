"""The simulated robot does exactly what it planned, and halts on command."""

import asyncio
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.robot import (
    KinematicRobot,
    Limits,
    Pose,
    Robot,
    RobotStopped,
    TargetError,
    default_world,
)
from taskrpc.testing import VirtualTimeLoop
from tests.properties import examples

WORLD = default_world()
TYPES = ("move", "scan", "report")
targets = st.sampled_from(sorted(WORLD.places)) | st.tuples(
    st.floats(0.8, 3.2), st.floats(0.8, 3.2)
).map(lambda p: f"{p[0]},{p[1]}")
tasks = st.tuples(st.sampled_from(TYPES), targets)


def ignore(progress):
    pass


def run(scenario):
    """Run one Hypothesis example on a clock of its own."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(scenario())


def near(a, b, within=1e-6):
    return math.dist((a.x, a.y), (b.x, b.y)) <= within


async def started(robot, task_type="move", target="central", report=ignore):
    """Start a task and let it take its first step."""
    task = asyncio.create_task(robot.execute(task_type, target, report))
    await asyncio.sleep(0)
    return task


@settings(max_examples=examples(60))
@given(st.lists(tasks, min_size=1, max_size=5), st.sampled_from([0.5, 1.0, 7.0, 100.0]))
def test_a_task_takes_exactly_as_long_as_planned_and_ends_where_planned(queue, speed):
    async def scenario():
        robot = KinematicRobot(WORLD, speed=speed)
        now = asyncio.get_running_loop().time
        for task_type, target in queue:
            plan = robot.plan(task_type, target, robot.pose())
            began = now()
            result = await robot.execute(task_type, target, ignore)
            assert (now() - began) * speed == pytest.approx(plan.seconds, abs=1e-6)
            assert robot.pose() == plan.end
            assert result["pose"] == {"x": plan.end.x, "y": plan.end.y, "theta": plan.end.theta}
            assert robot.remaining() == 0.0

    run(scenario)


@settings(max_examples=examples(40))
@given(tasks, st.floats(0, 1))
def test_remaining_and_plan_agree_at_every_moment(task, share):
    async def scenario():
        robot = KinematicRobot(WORLD)
        plan = robot.plan(*task, robot.pose())
        running = await started(robot, *task)
        await asyncio.sleep(share * plan.seconds)
        assert robot.remaining() == pytest.approx((1 - share) * plan.seconds, abs=1e-6)
        await running

    run(scenario)


@settings(max_examples=examples(40))
@given(tasks, st.lists(st.tuples(st.floats(0, 3), st.floats(0, 3)), max_size=4))
def test_a_task_paused_again_and_again_still_gets_there(task, pauses):
    async def scenario():
        robot = KinematicRobot(WORLD)
        now = asyncio.get_running_loop().time
        plan = robot.plan(*task, robot.pose())
        progress = []
        running = await started(robot, *task, progress.append)
        for go, halt in pauses:
            await asyncio.sleep(go)
            robot.pause()
            pose, left = robot.pose(), robot.remaining()
            await asyncio.sleep(halt)
            assert (robot.pose(), robot.remaining()) == (pose, left)
            robot.resume()
        ends_at = now() + robot.remaining()
        await running
        assert now() == pytest.approx(ends_at, abs=1e-6)
        assert near(robot.pose(), plan.end)
        assert progress == sorted(progress)
        assert progress[-1] == 1.0

    run(scenario)


async def test_a_pause_halts_and_a_resume_accelerates_again():
    robot = KinematicRobot(WORLD)
    now = asyncio.get_running_loop().time
    running = await started(robot)
    await asyncio.sleep(3.0)
    left = robot.remaining()
    robot.pause()
    halted, left_from_rest = robot.pose(), robot.remaining()
    assert left_from_rest > left
    await asyncio.sleep(60.0)
    assert robot.pose() == halted
    assert not running.done()
    robot.resume()
    began = now()
    result = await running
    assert now() - began == pytest.approx(left_from_rest)
    assert result["distance"] == pytest.approx(math.dist(WORLD.dock, WORLD.places["central"]))


async def test_pause_during_the_work_keeps_its_progress():
    robot = KinematicRobot(WORLD)
    running = await started(robot, "scan", "dock")
    await asyncio.sleep(1.0)
    robot.pause()
    await asyncio.sleep(5.0)
    assert robot.remaining() == pytest.approx(2.0)
    robot.resume()
    await running
    assert asyncio.get_running_loop().time() == pytest.approx(8.0)


async def test_a_pause_holds_the_next_task_until_resume():
    robot = KinematicRobot(WORLD)
    robot.pause()
    running = await started(robot, "report", "dock")
    await asyncio.sleep(10.0)
    assert robot.remaining() == 1.0
    robot.resume()
    await running
    assert asyncio.get_running_loop().time() == pytest.approx(11.0)


async def test_second_pause_and_second_resume_change_nothing():
    robot = KinematicRobot(WORLD)
    running = await started(robot, "report", "dock")
    for change in (robot.resume, robot.pause, robot.pause, robot.resume, robot.resume):
        change()
    await running
    assert asyncio.get_running_loop().time() == pytest.approx(1.0)


async def test_the_end_of_a_task_ends_its_pause():
    robot = KinematicRobot(WORLD)
    running = await started(robot)
    robot.pause()
    running.cancel()
    await asyncio.wait([running])
    await asyncio.wait_for(robot.execute("report", "dock", ignore), 2.0)


@settings(max_examples=examples(40))
@given(tasks, st.floats(0, 1))
def test_a_cancelled_robot_stays_where_it_is_and_can_go_on_from_there(task, share):
    async def scenario():
        robot = KinematicRobot(WORLD)
        plan = robot.plan(*task, robot.pose())
        running = await started(robot, *task)
        await asyncio.sleep(share * plan.seconds * 0.999)
        halted = robot.pose()
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
        assert robot.pose() == halted
        assert robot.remaining() == 0.0
        await asyncio.sleep(5.0)
        assert robot.pose() == halted
        again = robot.plan(*task, halted)
        began = asyncio.get_running_loop().time()
        await robot.execute(*task, ignore)
        took = asyncio.get_running_loop().time() - began
        assert took == pytest.approx(again.seconds, abs=1e-6)
        assert near(robot.pose(), plan.end)

    run(scenario)


async def test_stop_ends_a_running_task_and_the_robot_stays_usable():
    robot = KinematicRobot(WORLD)
    running = await started(robot)
    await asyncio.sleep(2.0)
    halted = robot.pose()
    robot.stop()
    assert (robot.pose(), robot.remaining()) == (halted, 0.0)
    with pytest.raises(RobotStopped, match="the robot was stopped"):
        await running
    await asyncio.sleep(1.0)
    assert robot.pose() == halted
    await robot.execute("move", "dock", ignore)
    assert near(robot.pose(), Pose(1.0, 1.0, 0.0))


async def test_stop_also_ends_a_paused_task_and_does_nothing_to_an_idle_robot():
    robot = KinematicRobot(WORLD)
    robot.stop()
    running = await started(robot)
    robot.pause()
    robot.stop()
    with pytest.raises(RobotStopped):
        await running
    await robot.execute("report", "dock", ignore)


async def test_progress_rises_about_ten_times_a_second_to_one():
    robot = KinematicRobot(WORLD, speed=2.0)
    seen = []
    plan = robot.plan("move", "central", robot.pose())
    await robot.execute("move", "central", seen.append)
    assert seen == sorted(set(seen))
    assert seen[-1] == 1.0
    assert abs(len(seen) - plan.seconds / 2.0 / 0.1) <= 2
    assert seen[0] == pytest.approx(0.2 / plan.seconds)


async def test_progress_does_not_fall_when_a_pause_makes_the_task_longer():
    robot = KinematicRobot(WORLD)
    seen = []
    running = await started(robot, report=seen.append)
    for _ in range(5):
        await asyncio.sleep(0.35)
        robot.pause()
        await asyncio.sleep(0.35)
        robot.resume()
    await running
    assert seen == sorted(seen)


async def test_move_to_own_position_takes_no_time():
    robot = KinematicRobot(WORLD)
    assert robot.plan("move", "1,1", robot.pose()).seconds == 0.0
    assert (await robot.execute("move", "dock", ignore))["distance"] == 0.0
    assert asyncio.get_running_loop().time() == 0.0


# -- tasks in a row ------------------------------------------------------------------------------


@pytest.mark.parametrize("lateness", [0.0, 0.005, 0.2])
async def test_late_timers_do_not_add_up_over_a_queue(lateness):
    """Twenty tasks in a row end as planned, plus the lateness of the last one only."""
    robot = KinematicRobot(WORLD)
    loop = asyncio.get_running_loop()
    planned, pose = 0.0, robot.pose()
    for target in ["central", "dock"] * 10:
        plan = robot.plan("move", target, pose)
        planned, pose = planned + plan.seconds, plan.end
        running = await started(robot, "move", target)
        loop.call_later(robot.remaining() - 1e-6, loop.advance, lateness)
        await running
    assert loop.time() == pytest.approx(planned + lateness, abs=1e-5)


async def test_a_task_that_arrives_at_an_idle_robot_starts_when_it_arrives():
    robot = KinematicRobot(WORLD)
    loop = asyncio.get_running_loop()
    await robot.execute("report", "dock", ignore)
    await asyncio.sleep(0.1)  # the server's settle time
    began = loop.time()
    await robot.execute("report", "dock", ignore)
    assert loop.time() - began == pytest.approx(1.0)


async def test_a_loop_that_hung_for_long_does_not_send_the_robot_into_the_past():
    robot = KinematicRobot(WORLD)
    loop = asyncio.get_running_loop()
    loop.call_at(0.999, loop.advance, 10.0)
    await robot.execute("report", "dock", ignore)
    began = loop.time()
    await robot.execute("report", "dock", ignore)
    assert loop.time() - began == pytest.approx(1.0)


@pytest.mark.parametrize("share", [0.05, 0.5])
async def test_a_cancelled_task_hands_no_instant_on(share):
    robot = KinematicRobot(WORLD)
    await robot.execute("report", "dock", ignore)
    running = await started(robot, "report", "dock")
    await asyncio.sleep(share)
    running.cancel()
    await asyncio.wait([running])
    began = asyncio.get_running_loop().time()
    await robot.execute("report", "dock", ignore)
    assert asyncio.get_running_loop().time() - began == pytest.approx(1.0)


async def test_a_stop_at_the_very_instant_of_the_end_is_a_stop():
    robot = KinematicRobot(WORLD, speed=100.0)
    running = await started(robot, "report", "dock")
    asyncio.get_running_loop().call_at(0.01, robot.stop)  # just behind the robot's own timer
    with pytest.raises(RobotStopped):
        await running
    await robot.execute("report", "dock", ignore)


def test_robot_works_on_another_event_loop():
    robot = KinematicRobot(WORLD)
    levels = []

    async def scenario():
        await asyncio.sleep(100.0 - 90.0 * len(levels))
        began = asyncio.get_running_loop().time()
        levels.append((await robot.execute("report", "2,2", ignore))["battery"])
        return asyncio.get_running_loop().time() - began

    away = robot.plan("report", "2,2", robot.pose()).seconds
    assert run(scenario) == pytest.approx(away)
    assert run(scenario) == pytest.approx(1.0)
    assert levels[1] < levels[0]


# -- results -------------------------------------------------------------------------------------


async def test_results_are_json_with_the_fields_of_the_lecture():
    robot = KinematicRobot(WORLD)
    move = await robot.execute("move", "central", ignore)
    scan = await robot.execute("scan", "area_a", ignore)
    report = await robot.execute("report", "area_a", ignore)
    assert json.loads(json.dumps([move, scan, report])) == [move, scan, report]
    assert set(move) == {"pose", "distance"}
    assert set(scan) == {"pose", "angle_min", "angle_increment", "range_max", "ranges"}
    assert set(report) == {"pose", "battery", "odometer"}
    to_central = math.dist(WORLD.dock, WORLD.places["central"])
    to_area = math.dist(WORLD.places["central"], WORLD.places["area_a"])
    assert move["distance"] == pytest.approx(to_central)
    assert report["odometer"] == pytest.approx(to_central + to_area)
    assert 90.0 < report["battery"] < 100.0


async def test_the_ranges_of_a_scan_are_those_of_the_map():
    robot = KinematicRobot(WORLD)
    scan = await robot.execute("scan", "area_a", ignore)
    pose = robot.pose()
    angles = [scan["angle_min"] + k * scan["angle_increment"] for k in range(len(scan["ranges"]))]
    assert len(angles) == 360
    assert angles[0] == -math.pi
    assert angles[180] == pytest.approx(0.0)
    assert scan["ranges"] == pytest.approx(WORLD.cast(pose, angles, scan["range_max"]), abs=1e-4)


async def test_the_battery_falls_on_the_way_and_recovers_at_the_dock():
    robot = KinematicRobot(WORLD)

    async def level(target):
        return (await robot.execute("report", target, ignore))["battery"]

    away = await level("warehouse")
    assert away < 100.0
    further = await level("central")
    assert further < away
    docked = await level("dock")
    await asyncio.sleep(1.0)
    assert await level("dock") == pytest.approx(docked + 2 * 0.5)  # the wait and the report
    await asyncio.sleep(600.0)
    assert await level("dock") == 100.0


async def test_a_long_wait_away_from_the_dock_never_empties_the_battery():
    robot = KinematicRobot(WORLD, speed=1000.0)
    await robot.execute("move", "central", ignore)
    await asyncio.sleep(3600.0)
    report = await robot.execute("report", "central", ignore)
    assert report["battery"] == 5.0


# -- refusals ------------------------------------------------------------------------------------


async def test_a_wrong_target_is_refused_alike_by_plan_and_execute():
    robot = KinematicRobot(WORLD)
    with pytest.raises(TargetError, match="unknown target 'moon'"):
        robot.plan("move", "moon", robot.pose())
    with pytest.raises(TargetError, match="unknown target 'moon'"):
        await robot.execute("move", "moon", ignore)
    await robot.execute("report", "dock", ignore)


async def test_a_task_type_that_it_does_not_know_is_refused():
    with pytest.raises(ValueError, match="unknown task 'fly': expected move, scan, report"):
        await KinematicRobot(WORLD).execute("fly", "dock", ignore)


async def test_second_simultaneous_task_is_refused_and_the_first_continues():
    robot = KinematicRobot(WORLD)
    running = await started(robot)
    with pytest.raises(RuntimeError, match="one task at a time"):
        await robot.execute("report", "dock", ignore)
    await running


async def test_an_error_in_the_progress_callback_halts_the_robot():
    robot = KinematicRobot(WORLD)

    def broken(progress):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        await robot.execute("move", "central", broken)
    halted = robot.pose()
    await asyncio.sleep(1.0)
    assert (robot.pose(), robot.remaining()) == (halted, 0.0)


@pytest.mark.parametrize("speed", [0.0, -1.0, math.inf, math.nan])
def test_a_speed_must_be_a_positive_number(speed):
    with pytest.raises(ValueError, match="speed must be a positive number, not"):
        KinematicRobot(WORLD, speed=speed)


def test_a_robot_cannot_start_inside_a_wall():
    with pytest.raises(ValueError, match=r"the robot cannot stand at its start, 7\.5,6"):
        KinematicRobot(WORLD, start=Pose(7.5, 6.0, 0.0))


def test_an_idle_robot_answers_without_an_event_loop():
    robot: Robot = KinematicRobot(WORLD, start=Pose(2.0, 2.0, 1.0), limits=Limits(speed=0.5))
    assert robot.pose() == Pose(2.0, 2.0, 1.0)
    assert robot.remaining() == 0.0
    assert robot.plan("move", "2,2", robot.pose()).seconds == 0.0


@pytest.mark.real_time
async def test_queue_takes_the_planned_time_on_the_real_clock():
    robot = KinematicRobot(WORLD, speed=100.0)
    loop = asyncio.get_running_loop()
    planned, pose, began = 0.0, robot.pose(), loop.time()
    for target in ["central", "area_a", "dock"] * 2:
        plan = robot.plan("move", target, pose)
        planned, pose = planned + plan.seconds / 100.0, plan.end
        await robot.execute("move", target, ignore)
    assert robot.pose() == pose
    assert planned - 0.02 <= loop.time() - began <= planned + 0.5
