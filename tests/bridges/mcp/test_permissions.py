"""What an agent may do, with a policy and without."""

import pytest

import srvgen
from taskrpc.bridges.door import Decision, Door, Outcome
from taskrpc.bridges.mcp.permissions import Permissions, Refused
from tests.bridges.mcp.doors import TableDoor


def test_without_a_policy_everything_is_shown_and_allowed():
    permissions = Permissions()
    assert permissions.shows("call", "/anything")
    assert permissions.check("read", "/anything")


def test_services_that_every_node_has_are_shown_only_by_a_policy():
    door = TableDoor(arm__get_parameters=Decision(Outcome.ALLOWED))
    assert not Permissions().shows("call", "/arm/get_parameters")
    assert Permissions(door).shows("call", "/arm/get_parameters")


def test_policy_decides_with_the_name_and_the_message():
    door = TableDoor(arm=Decision(Outcome.ALLOWED))
    permissions = Permissions(door, "agents")
    assert permissions.shows("call", "/arm")
    assert not permissions.shows("call", "/leg")
    assert permissions.check("call", "/arm", "message")
    assert door.asked == [("agents", "call", "/arm", "message")]


def test_dry_run_is_not_carried_out():
    assert not Permissions(TableDoor(arm=Decision(Outcome.DRY_RUN))).check("call", "/arm")


@pytest.mark.parametrize(
    ("decision", "text"),
    [
        (Decision(Outcome.REFUSED, 7, "too fast", 2.5), "too fast (line 7 of the policy)"),
        (Decision(Outcome.REFUSED, 0, "no name"), "no name"),
        (
            Decision(Outcome.NEEDS_APPROVAL, 4),
            "a person must approve call /arm, and this bridge cannot ask one"
            " (line 4 of the policy)",
        ),
    ],
)
def test_refusal_names_the_rule(decision, text):
    with pytest.raises(Refused) as refused:
        Permissions(TableDoor(arm=decision)).check("call", "/arm")
    assert str(refused.value) == text
    assert (refused.value.line, refused.value.retry_after) == (decision.line, decision.retry_after)


def test_policy_of_a_file_decides(tmp_path):
    file = tmp_path / "door.yaml"
    file.write_text("agents: {may: [call /robot_task], limits: {/robot_task: {priority: 1..5}}}")
    file.chmod(0o644)
    permissions = Permissions(Door(file), "agents")
    robot_task = srvgen.load("my_robot_interfaces/srv/RobotTask")
    assert permissions.shows("call", "/robot_task")
    assert not permissions.shows("call", "/robot_task/stop")
    assert permissions.check("call", "/robot_task", robot_task.Request(priority=3))
    with pytest.raises(Refused, match="expected 1 to 5, got 9"):
        permissions.check("call", "/robot_task", robot_task.Request(priority=9))
