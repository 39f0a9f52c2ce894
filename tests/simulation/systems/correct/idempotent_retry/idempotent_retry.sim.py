"""A blocking client repeats an idempotent call, with waits, until the restarted robot has it."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=120.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(
    lose_requests=0.05,
    lose_responses=0.05,
    delay=(0.0, 0.1),
    crash=("robot",),
    restart=(0.5, 3.0),
)


@scenario.finally_
def every_light_was_switched(world):
    for number in range(5):
        assert world.count("student", f"light {number} is on") == 1
        assert world.count("robot", f"switches light {number}") >= 1
