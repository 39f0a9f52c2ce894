"""A ROS client waits with a timeout: in ROS, the future of a lost call stays undone."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("cashier", "cashier.py")
scenario.program("customer", "customer.py")
scenario.faults(
    lose_requests=0.05,
    lose_responses=0.05,
    busy=0.05,
    duplicate_requests=0.05,
    delay=(0.0, 0.2),
    partition=(1.0, 4.0),
    crash=("cashier",),
    restart=(0.5, 2.0),
)


@scenario.finally_
def each_question_has_an_end(world):
    answers = world.count("customer", "costs") + world.count("customer", "no answer")
    assert answers == 5
