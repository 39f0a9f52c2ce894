"""The deadline is shorter than the work may take; the cancelled work leaves the gripper shut."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(delay=(0.0, 0.1))


@scenario.finally_
def gripper_is_open(world):
    assert world.count("robot", "closes") == world.count("robot", "opens")
