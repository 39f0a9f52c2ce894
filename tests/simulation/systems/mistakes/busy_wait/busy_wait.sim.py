"""The student waits in a loop that lets nobody else run, and nothing spins the node."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=20.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
