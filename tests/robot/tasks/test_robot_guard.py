from taskrpc.robot.protocol import Plan, Pose, TargetError
from taskrpc.robot.tasks.robot_guard import RobotGuard
from tests.robot.tasks.fakes import LineRobot


class Planner(LineRobot):
    """Raises or returns what it is told."""

    def __init__(self, outcome):
        super().__init__()
        self.outcome = outcome

    def plan(self, task_type, target, start):
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


def refusal(outcome):
    return RobotGuard(Planner(outcome)).refusal("move", "1")


def test_task_that_the_robot_can_plan_is_not_refused():
    assert refusal(Plan(3.0, Pose(0.0, 0.0, 0.0))) == ""


def test_refusal_tells_a_wrong_target_from_a_robot_that_fails():
    assert refusal(TargetError("no such shelf")) == "Invalid target: no such shelf"
    assert refusal(OSError("no map")) == "The robot cannot plan this task: OSError: no map"
    endless = refusal(Plan(float("inf"), Pose(0.0, 0.0, 0.0)))
    assert endless.startswith("The robot cannot plan this task: ValueError: expected a plan of 0")


def test_pose_of_a_robot_that_fails_is_the_last_known_one(caplog):
    robot = LineRobot()
    guard = RobotGuard(robot)
    known = guard.pose()

    def fails():
        raise OSError("the sensor is off")

    robot.pose = fails
    assert [guard.pose(), guard.pose()] == [known, known]
    assert caplog.text.count("the sensor is off") == 1
