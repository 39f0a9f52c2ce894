"""Two forklifts reserve a cell with one call that checks and takes it; leaving is repeated."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("cell", "cell.py")
scenario.program("first", "forklift.py", "first")
scenario.program("second", "forklift.py", "second")
scenario.faults(lose_requests=0.05, lose_responses=0.05, delay=(0.0, 0.1))


@scenario.always
def one_forklift_in_the_cell(world):
    inside = sum(
        world.count(name, "enters") - world.count(name, "leaves") for name in ("first", "second")
    )
    assert inside <= 1


@scenario.finally_
def both_did_their_work(world):
    for name in "first", "second":
        assert world.count(name, "leaves") == 3
