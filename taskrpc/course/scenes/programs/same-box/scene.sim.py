from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("shop", "shop.py")


@scenario.finally_
def each_customer_gets_a_box_of_their_own(world):
    boxes = [line.partition(" gets ")[2] for line in world.lines("shop")]
    assert len(set(boxes)) == len(boxes), f"{boxes[0]} was given away twice"
