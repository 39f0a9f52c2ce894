"""The student repeats an order without a request id, so a lost response lets it run twice."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(lose_responses=0.05, delay=(0.0, 0.1))


@scenario.always
def no_item_is_picked_twice(world):
    for item in range(5):
        assert world.count("robot", f"picks item {item}") <= 1
