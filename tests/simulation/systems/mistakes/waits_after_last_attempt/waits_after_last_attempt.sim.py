"""The student waits only after the last attempt, so all attempts fail while the robot restarts."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(crash=("robot",), restart=(1.0, 3.0))


@scenario.finally_
def nothing_is_given_up(world):
    assert world.count("student", "gives up") == 0
