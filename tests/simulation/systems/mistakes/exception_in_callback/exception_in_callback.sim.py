"""A callback expects a message that has not come yet; its exception ends the server."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=5.0)
scenario.program("camera", "camera.py")
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.1))
