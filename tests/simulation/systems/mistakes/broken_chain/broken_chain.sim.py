"""Each response starts the next drive, so the chain ends where one response is lost."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=20.0)
scenario.program("robot", "robot.py")
scenario.program("patrol", "patrol.py")
scenario.faults(lose_responses=0.02, delay=(0.0, 0.1))


@scenario.finally_
def patrol_is_complete(world):
    assert world.count("robot", "drives to") == 6
