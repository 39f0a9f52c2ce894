"""The shop takes a missing response for a failure and pays back an order that was carried out."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=20.0)
scenario.program("robot", "robot.py")
scenario.program("shop", "shop.py")
scenario.faults(lose_requests=0.03, lose_responses=0.03, delay=(0.0, 0.2))


@scenario.finally_
def nothing_is_delivered_and_paid_back(world):
    for order in range(5):
        delivered = world.count("robot", f"delivers order {order}")
        paid_back = world.count("shop", f"pays back order {order}")
        assert delivered + paid_back == 1, f"order {order}: {delivered} + {paid_back}"
