"""Two threads of a blocking program call one robot, and pass their results through a queue."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("robot", "robot.py")
scenario.program("students", "students.py")
scenario.faults(delay=(0.0, 0.1))


@scenario.always
def one_motion_at_a_time(world):
    assert world.count("robot", "begins") - world.count("robot", "ends") <= 1


@scenario.finally_
def all_results_are_there(world):
    assert world.lines("students") == ["results: [0, 1, 2, 10, 11, 12]"]
