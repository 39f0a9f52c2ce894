"""The map is published once and not kept, so a robot that starts later never gets it."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("robot", "robot.py")
scenario.program("mapper", "mapper.py")


@scenario.finally_
def robot_has_the_map(world):
    assert world.count("robot", "has the map") == 1
