"""The student never looks at the exception of a future, and takes its end for a success."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(lose_requests=0.05, delay=(0.0, 0.1))


@scenario.finally_
def what_is_reported_was_watered(world):
    for plant in range(4):
        if world.count("student", f"plant {plant} is watered"):
            assert world.count("robot", f"waters plant {plant}") == 1
