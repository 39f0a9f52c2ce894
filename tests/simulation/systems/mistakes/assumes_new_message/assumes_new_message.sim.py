"""A timer divides by the new messages since its last tick, and there may be none."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("odometry", "odometry.py")
scenario.program("wheel", "wheel.py")
scenario.faults(delay=(0.0, 0.2))
