"""A shop keeps its stock in a variable, and has it back in full after a restart."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=20.0)
scenario.program("shop", "shop.py")
scenario.program("customer", "customer.py")
scenario.faults(crash=("shop",), restart=(0.5, 2.0))


@scenario.always
def no_more_is_sold_than_there_was(world):
    assert world.count("shop", "sells") <= 3
