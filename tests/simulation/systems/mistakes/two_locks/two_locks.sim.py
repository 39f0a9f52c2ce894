"""Two services of the robot take the same two locks in opposite order."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("loader", "user.py", "load")
scenario.program("unloader", "user.py", "unload")
