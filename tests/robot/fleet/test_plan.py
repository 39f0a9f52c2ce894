from hypothesis import given
from hypothesis import strategies as st

from taskrpc.robot.fleet.model import Abilities
from taskrpc.robot.fleet.plan import HORIZON, PATIENCE, FleetPlan
from tests.robot.fleet.fakes import line_plan, robot, task


def plan(tasks, robots, *, now=0.0, own=""):
    def task_at(index):
        return tasks[index] if index < len(tasks) else None

    return FleetPlan(task_at, robots, Abilities(robots), now, line_plan, own)


def chosen(tasks, robots, **options):
    made = plan(tasks, robots, **options)
    found = (made.find(each.task_id) for each in tasks)
    return [None if each is None else (each.robot, each.begins, each.ends) for each in found]


def test_task_goes_to_the_robot_that_ends_it_first():
    robots = [robot("far", 9), robot("near", 2)]
    assert chosen([task(1, "1")], robots) == [("near", 0.0, 2.0)]


def test_idle_robot_far_away_waits_for_a_near_one_that_is_about_to_be_free():
    robots = [robot("far", 20), robot("near", 1, task_id=7, free_at=3.0)]
    assert chosen([task(1, "1")], robots) == [("near", 3.0, 4.0)]


def test_later_task_starts_where_the_earlier_one_ends():
    robots = [robot("only", 0)]
    expected = [("only", 0.0, 6.0), ("only", 6.0, 11.0)]
    assert chosen([task(1, "5"), task(2, "1")], robots) == expected


def test_faster_robot_needs_less_time():
    robots = [robot("slow", 0), robot("fast", 0, speed=2.0)]
    assert chosen([task(1, "9")], robots) == [("fast", 0.0, 5.0)]


def test_task_that_no_robot_is_able_to_execute_is_not_planned_and_delays_nothing():
    robots = [robot("a", capabilities="move")]
    tasks = [task(1, task_type="scan"), task(2, "1")]
    assert chosen(tasks, robots) == [None, ("a", 0.0, 2.0)]


def test_robot_that_is_late_is_expected_to_be_late_by_as_much_again():
    robots = [robot("late", 0, task_id=7, free_at=10.0)]
    assert chosen([task(1, "0")], robots, now=14.0) == [("late", 18.0, 19.0)]


def test_robot_of_another_server_that_does_not_begin_is_left_out_after_a_while():
    robots = [robot("near", 1, free_at=0.0), robot("own", 5, free_at=0.0)]
    tasks = [task(1, "1", submitted_at=0.0)]
    assert chosen(tasks, robots, now=PATIENCE, own="own")[0][0] == "near"
    assert chosen(tasks, robots, now=PATIENCE + 0.1, own="own")[0][0] == "own"
    assert chosen(tasks, robots, now=PATIENCE + 0.1, own="near")[0][0] == "near"


def test_first_task_of_a_robot_is_found_without_planning_the_rest():
    robots = [robot("a", 0), robot("b", 100)]
    tasks = [task(1, "0"), task(2, "100"), task(3, "50")]
    made = plan(tasks, robots)
    assert made.first_of("b").task_id == 2
    assert made.first_of("a").task_id == 1


def test_robot_without_a_task_has_no_first_one():
    robots = [robot("a", 0), robot("b", 1000)]
    assert plan([task(1, "0"), task(2, "0")], robots).first_of("b") is None


def test_plan_continues_when_tasks_are_added_behind():
    robots, tasks = [robot("a", 0)], [task(1, "0")]
    made = plan(tasks, robots)
    assert made.free_at() == 1.0
    tasks.append(task(2, "0"))
    assert made.find(2).ends == 2.0
    assert made.seconds_for_each() == 1.0


def test_only_tasks_within_the_horizon_are_planned_one_by_one():
    tasks = [task(number + 1, "0") for number in range(HORIZON + 1)]
    made = plan(tasks, [robot("a", 0)])
    assert made.find(HORIZON).ends == HORIZON
    assert made.find(HORIZON + 1) is None


ROBOTS = st.lists(st.integers(0, 20), min_size=1, max_size=4)
TARGETS = st.lists(st.integers(0, 20), max_size=12)


@given(places=ROBOTS, targets=TARGETS)
def test_each_robot_executes_one_task_at_a_time_and_the_order_is_kept(places, targets):
    robots = [robot(f"r{index}", x) for index, x in enumerate(places)]
    tasks = [task(index + 1, str(x)) for index, x in enumerate(targets)]
    free = dict.fromkeys((each.name for each in robots), 0.0)
    for name, begins, ends in chosen(tasks, robots):
        assert begins == free[name]
        assert ends > begins
        free[name] = ends


@given(places=ROBOTS, targets=TARGETS, count=st.integers(1, 12))
def test_task_behind_changes_nothing_for_tasks_ahead(places, targets, count):
    robots = [robot(f"r{index}", x) for index, x in enumerate(places)]
    tasks = [task(index + 1, str(x)) for index, x in enumerate(targets)]
    assert chosen(tasks, robots)[:count] == chosen(tasks[:count], robots)
