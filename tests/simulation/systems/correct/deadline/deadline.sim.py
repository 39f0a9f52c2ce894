"""The robot opens its gripper also when the deadline cancels the work, or refuses in time."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("robot", "robot.py")
scenario.program("student", "student.py")
scenario.faults(lose_requests=0.05, lose_responses=0.05, delay=(0.0, 0.2))


@scenario.finally_
def gripper_is_open(world):
    assert world.count("robot", "closes") == world.count("robot", "opens")
    assert world.count("student", "cup") == 5


@scenario.always
def one_cup_at_a_time(world):
    assert world.count("robot", "closes") - world.count("robot", "opens") in (0, 1)


@scenario.finally_
def robot_does_not_notice_that_the_student_ends(world):
    assert world.count("robot", "Traceback") == 0
