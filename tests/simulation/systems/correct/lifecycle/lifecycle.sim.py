"""A manager configures and activates a lifecycle node, which publishes only while it is active."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("sensor", "sensor.py")
scenario.program("manager", "manager.py")
scenario.faults(delay=(0.0, 0.1))


@scenario.always
def nothing_is_published_before_it_is_active(world):
    if world.count("sensor", "is active") == 0:
        assert world.messages("/distance") == []


@scenario.finally_
def sensor_went_through_its_states(world):
    for words in "is configured", "is active", "is inactive":
        assert world.count("sensor", words) == 1, words
    assert world.count("manager", "ready") == 1
    assert 2 <= len(world.messages("/distance")) <= 10
