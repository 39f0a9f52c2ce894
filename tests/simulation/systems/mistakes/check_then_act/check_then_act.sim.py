"""Each of two forklifts asks whether the cell is free before it enters, so both may enter."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("cell", "cell.py")
scenario.program("first", "forklift.py", "first")
scenario.program("second", "forklift.py", "second")
scenario.faults(delay=(0.0, 0.05))


@scenario.always
def one_forklift_in_the_cell(world):
    inside = sum(
        world.count(name, "enters") - world.count(name, "leaves") for name in ("first", "second")
    )
    assert inside <= 1
