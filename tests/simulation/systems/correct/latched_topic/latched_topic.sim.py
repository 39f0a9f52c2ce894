"""The map is kept for robots that start later (transient_local), also after a restart."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=15.0)
scenario.program("robot", "robot.py")
scenario.program("mapper", "mapper.py")
scenario.faults(delay=(0.0, 0.1), crash=("robot",), restart=(0.5, 2.0))


@scenario.finally_
def each_robot_has_the_map(world):
    assert len(world.messages("/map")) == 1
    assert world.count("robot", "has the map") >= 1
