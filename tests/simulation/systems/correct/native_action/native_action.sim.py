"""An action of taskrpc with feedback; the client cancels and looks whether the server agreed."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.2))


@scenario.finally_
def both_say_the_same(world):
    for order in range(1, 6):
        arrived = world.count("robot", f"arrives at {order}")
        assert world.count("student", f"{order} is done") == arrived
        assert world.count("student", f"{order} is cancelled") == 1 - arrived
