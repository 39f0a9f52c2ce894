"""A broadcaster publishes where the arm is, and a listener looks the transform up."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("broadcaster", "broadcaster.py")
scenario.program("listener", "listener.py")
scenario.faults(delay=(0.0, 0.2))


@scenario.finally_
def listener_knows_the_arm(world):
    seen = [line for line in world.lines("listener") if "the arm is at" in line]
    assert len(seen) >= 5, world.lines("listener")
    heights = [float(line.split()[-1]) for line in seen]
    assert heights == sorted(heights)
