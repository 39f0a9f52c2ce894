"""A callback calls another service and waits, in the only thread that could get the response."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("arm", "arm.py")
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.1))
