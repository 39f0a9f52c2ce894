"""The student repeats a refused call at once and without end."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")


@scenario.always
def calls_are_few(world):
    assert world.calls("/dock") <= 20
