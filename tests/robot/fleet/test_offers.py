from taskrpc.robot.fleet.offers import refuse_unable, waits_for
from tests.robot.fleet.fakes import robot, state_of, task


def test_refusal_names_what_each_robot_offers():
    state = state_of(
        robot("a", places=("attic", "dock"), size=(6.0, 4.5)),
        robot("b", places=("attic", "dock"), size=(6.0, 4.5)),
        robot("c", task_types=("lift",), capabilities="lift:shelf_*"),
        robot("gone", is_gone=True),
    )
    assert refuse_unable(state, 0.0, "move", "attik") == (
        "Invalid target: no robot of the fleet is able to execute move at attik"
        " (did you mean attic?)."
        " a, b: move or scan at attic, dock or x,y up to 6,4.5; c: lift, limited to lift:shelf_*"
    )
    assert refuse_unable(state, 0.0, "fly", "attic") == (
        "Invalid task: fly (expected move, scan or lift)"
    )


def test_refusal_by_a_large_fleet_is_cut():
    state = state_of(*(robot(f"r{n}", places=(f"place_{n}",)) for n in range(200)))
    assert len(refuse_unable(state, 0.0, "move", "moon")) == 1000


def test_task_waits_only_while_no_able_robot_works():
    state = state_of(task(1), robot("a", is_gone=True), robot("b", paused=True))
    assert waits_for(state, 0.0, task(1)) == "waits for a, which is away or b, which is paused"
    state.put_robot(robot("c"))
    assert waits_for(state, 0.0, task(1)) == ""


def test_robot_that_has_not_run_for_a_week_is_not_waited_for():
    state = state_of(robot("a", lease_until=100.0))
    week = 7 * 24 * 3600
    assert waits_for(state, 99.0 + week, task(1)) == "waits for a, which is away"
    assert waits_for(state, 101.0 + week, task(1)) == ""
