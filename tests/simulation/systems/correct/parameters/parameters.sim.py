"""A client sets a parameter of another node, reads it back, and a callback guards its range."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("tuner", "tuner.py")
scenario.faults(delay=(0.0, 0.1))


@scenario.always
def speed_is_never_too_high(world):
    assert world.count("robot", "speed 9.0") == 0


@scenario.finally_
def parameters_were_set(world):
    assert world.count("tuner", "set to 1.5: True") == 1
    assert world.count("tuner", "set to 9.0: False") == 1
    assert world.count("tuner", "reads 1.5") == 1
    assert world.count("robot", "speed 1.5") >= 1
