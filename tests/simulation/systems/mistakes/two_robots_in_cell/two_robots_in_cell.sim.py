"""The cell forgets at a resume that a robot is inside, so it lets a second one in."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=12.0)
scenario.program("cell", "cell.py")
scenario.program("pilot", "pilot.py")
scenario.program("left", "robot.py", "left")
scenario.program("right", "robot.py", "right")
scenario.faults(delay=(0.0, 0.1))


@scenario.always
def one_robot_in_the_cell(world):
    names = "left", "right"
    assert sum(world.count(each, "enters") - world.count(each, "leaves") for each in names) <= 1
