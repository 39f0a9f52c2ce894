"""The robot acts before it notes the order in the store, so a crash between them repeats it."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("store", "store.py")
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.05), crash=("robot",), restart=(0.5, 2.0))


@scenario.always
def no_order_is_poured_twice(world):
    for order in range(4):
        assert world.count("robot", f"pours order {order}") <= 1
