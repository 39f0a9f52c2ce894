"""A client cancels a goal that takes too long, and looks how the goal ended."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.2))


@scenario.finally_
def both_say_the_same(world):
    for order in (3, 4, 5, 8):
        arrived = world.count("robot", f"arrives at {order}")
        canceled = world.count("robot", f"stops on the way to {order}")
        assert world.count("student", f"{order} SUCCEEDED") == arrived
        assert world.count("student", f"{order} CANCELED") == canceled
        assert arrived + canceled == 1
