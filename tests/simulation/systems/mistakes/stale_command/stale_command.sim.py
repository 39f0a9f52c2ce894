"""A restarted robot gets the last command once more from a transient_local publisher and drives."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("pilot", "pilot.py")
scenario.program("robot", "robot.py")
scenario.faults(delay=(0.0, 0.1), crash=("robot",), restart=(0.5, 2.0))


@scenario.always
def each_command_drives_once(world):
    assert world.count("robot", "drives to the ramp") <= len(world.messages("/command"))
