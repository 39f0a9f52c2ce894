"""The student waits for a response without a timeout, so one lost response stops the program."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=20.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(lose_requests=0.02, lose_responses=0.02, delay=(0.0, 0.1))
