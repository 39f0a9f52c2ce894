from taskrpc.robot import KinematicRobot, World
from taskrpc.robot.fleet.own_robot import OwnRobot
from taskrpc.robot.tasks.robot_guard import RobotGuard
from tests.robot.fleet.fakes import robot, state_of
from tests.robot.tasks.fakes import LineRobot


def own(made, capabilities=""):
    return OwnRobot("a", RobotGuard(made), capabilities)


def test_record_tells_what_the_robot_reaches_and_where_its_server_runs():
    world = World((6.0, 4.0), dock=(1.0, 1.0), places={"attic": (5.0, 3.0), "wall": (0.0, 0.0)})
    record = own(KinematicRobot(world)).record()
    assert (record.places, record.size) == (("attic", "dock"), (6.0, 4.0))
    assert record.process == f"process {record.pid} on {record.host}"
    assert record.pid > 0


def test_robot_class_of_a_user_may_tell_its_places():
    class Places(LineRobot):
        places = ("1", "2", "lab")  # it cannot plan a drive to the last one

    assert own(Places()).record().places == ("1", "2")
    assert own(LineRobot()).record().places == ()


def test_robot_that_fails_refuses_no_target_for_ever():
    class Fails(LineRobot):
        def plan(self, task_type, target, start):
            raise OSError("the map server is away")

    assert own(Fails()).wrong_target("move", "1") == ""
    assert own(LineRobot()).wrong_target("move", "lab") == "expected a number, got 'lab'"


def test_server_accepts_what_the_record_of_another_robot_offers():
    records = (
        own(LineRobot()).record(),
        robot("b", places=("lab",)),
        robot("c", capabilities="move:shelf_*"),
        robot("d", size=(6.0, 4.0)),
        robot("e", task_types=("lift",)),
    )
    state = state_of(*records)

    def refusal(task_type, target):
        return own(LineRobot()).refusal(state, 0.0, task_type, target)

    accepted = ("move", "1"), ("move", "lab"), ("move", "shelf_3"), ("scan", "5,3"), ("lift", "x")
    for each in accepted:
        assert refusal(*each) == "", each
    for each in (("move", "moon"), ("scan", "shelf_3"), ("move", "7,3"), ("fly", "1")):
        assert refusal(*each), each
