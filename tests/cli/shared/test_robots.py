"""Several robots in one server, and the robot that a user's commands mean."""

import argparse

import pytest

from taskrpc.cli.shared import robots
from taskrpc.cli.shared.command import UsageError
from taskrpc.cli.shared.robots import for_each_robot, own_task_service, suffix_of, task_service
from taskrpc.cli.shared.task_database import default_database
from taskrpc.core.security.lab import Lab, remember_lab
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint

GIVEN = {
    "robots": 1,
    "namespace": "/",
    "map": None,
    "web": None,
    "db": None,
    "record": None,
    "standby": False,
    "robot": None,
}


def servers(**given):
    return for_each_robot(argparse.Namespace(**{**GIVEN, **given}))


def values(found, name):
    return [getattr(each, name) for each in found]


def test_one_robot_keeps_the_options():
    (found,) = servers(namespace="/lab7", map=["a.yaml"], web="127.0.0.1:8000", db="t.db")
    assert (found.namespace, found.map, found.web, found.db) == (
        "/lab7",
        "a.yaml",
        "127.0.0.1:8000",
        "t.db",
    )


def test_each_robot_has_a_namespace_a_database_and_a_page_of_its_own():
    found = servers(robots=3, web="0.0.0.0:8443", db="/tmp/t.db")
    assert values(found, "namespace") == ["/", "/robot2", "/robot3"]
    assert values(found, "web") == ["0.0.0.0:8443", "0.0.0.0:8444", "0.0.0.0:8445"]
    assert [each.replace("\\", "/") for each in values(found, "db")] == [
        *("/tmp/t.db", "/tmp/t_robot2.db", "/tmp/t_robot3.db"),
    ]
    assert values(servers(robots=2, web="127.0.0.1:0", db=":memory:"), "web") == ["127.0.0.1:0"] * 2


@pytest.mark.parametrize(
    ("maps", "found"),
    [(None, [None] * 3), (["a"], ["a"] * 3), (["a", "b"], ["a", "b", "b"])],
)
def test_maps_are_given_to_the_robots_in_turn_and_the_last_one_to_the_rest(maps, found):
    assert values(servers(robots=3, map=maps), "map") == found


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"map": ["a", "b"]}, "2 maps for 1 robot: give one --map for each robot"),
        ({"robots": 2, "map": ["a"] * 3}, "3 maps for 2 robots"),
        ({"robots": 2, "record": "a.mcap"}, "--robots 2: --record records one robot"),
        ({"robots": 2, "standby": True}, "--standby waits for the server of one robot"),
        ({"robots": 2, "robot": "a:B"}, "start one server for each, with --namespace"),
        ({"robots": 2, "namespace": "/x"}, "use it without --namespace"),
    ],
)
def test_options_of_a_single_robot_are_refused(given, message):
    with pytest.raises(UsageError, match=message):
        servers(**given)


def test_default_database_of_each_robot_has_its_own_name(monkeypatch):
    assert suffix_of("/") == ""
    assert default_database().name == "tasks.db"
    assert default_database("/robot2").name == "tasks_robot2.db"
    assert default_database("/a/b").name == "tasks_a_b.db"
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert default_database("/robot2").name == "tasks_domain_7_robot2.db"


def join(namespace):
    remember_lab(Lab(address="h:1", token="ada.secret", certificate="PEM", namespace=namespace))


def test_commands_of_a_student_mean_the_students_robot(monkeypatch):
    assert own_task_service() == "/robot_task"
    join("/ada")
    assert own_task_service() == "/robot_task"
    join("/robot2/ada")
    assert own_task_service() == "/robot2/robot_task" == task_service("/robot2")
    monkeypatch.setenv("TASKRPC_PEERS", "192.0.2.1:1")
    assert own_task_service() == "/robot_task", "the programs do not call the lab"


def test_server_of_this_machine_comes_before_the_lab(monkeypatch):
    join("/robot2/ada")
    own = ServiceEndpoint("/robot_task", "t", "h", "n")
    entry = RegistryEntry(77, "server.py", "/", 0.0, services=(own,))
    monkeypatch.setattr(robots.Registry, "entries", lambda _: [entry])
    assert own_task_service() == "/robot_task"
