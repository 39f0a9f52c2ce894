"""The student calls a service at once, without waiting until its server has started."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=20.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.1))
