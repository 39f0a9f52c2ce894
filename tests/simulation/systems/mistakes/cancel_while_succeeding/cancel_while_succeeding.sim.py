"""The student takes a goal for cancelled without looking whether the server agreed."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.2))


@scenario.finally_
def no_cancelled_goal_arrives(world):
    for order in range(1, 5):
        arrived = world.count("robot", f"arrives at {order}")
        canceled = world.count("student", f"{order} is cancelled")
        assert arrived + canceled <= 1, f"order {order} is cancelled and arrives"
