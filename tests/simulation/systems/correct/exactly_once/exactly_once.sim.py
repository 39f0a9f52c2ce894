"""Lost requests and responses are repeated with a request id, and the robot runs each once."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=120.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(lose_requests=0.1, lose_responses=0.1, delay=(0.0, 0.2))


@scenario.always
def no_item_is_picked_twice(world):
    for item in range(5):
        assert world.count("robot", f"picks item {item}") <= 1


@scenario.finally_
def every_order_is_carried_out(world):
    assert world.count("student", "has item") == 5
    assert world.count("robot", "picks item") == 5
