"""The client waits with a timeout, forgets the late response, and sends the next position."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=120.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(lose_requests=0.1, lose_responses=0.1, delay=(0.0, 0.1))


@scenario.finally_
def every_position_was_reached(world):
    for number in range(5):
        assert world.count("student", f"is at {number}") == 1
        assert world.count("robot", f"drives to {number}") >= 1
