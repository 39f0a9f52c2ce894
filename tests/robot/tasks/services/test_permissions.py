"""Students read, submit and cancel their own tasks; operators may do everything."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc import Account, Accounts, Role
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.robot.tasks.services.permissions import ROLES
from tests.robot.tasks.fakes import LineRobot
from tests.robot.tasks.test_server import Client

pytestmark = pytest.mark.real_time

PEOPLE = {
    role.name.lower(): Account(role.name.lower(), f"secret-of-{role.name:-<16}", role)
    for role in Role
}
PEOPLE["other"] = Account("other", "secret-of-another-student")


async def outcome(awaitable):
    try:
        answer = await awaitable
    except taskrpc.PermissionDenied as error:
        return str(error) if error.not_executed else "it may have run"
    except taskrpc.HandlerFailed as error:
        return f"{error.code.name}: {error.message}"
    return answer.success if hasattr(answer, "success") else True


@pytest.fixture
async def people():
    async with (
        taskrpc.Node("task_server", accounts=Accounts(PEOPLE.values())) as node,
        TaskServer(node, LineRobot(), MemoryStore()) as server,
    ):
        await server.manager.pause()
        clients = {}
        nodes = []
        for name, account in PEOPLE.items():
            laptop = taskrpc.Node("laptop", peers=[node.address], token=account.token)
            await laptop.start()
            nodes.append(laptop)
            clients[name] = Client(laptop)
        yield clients
        await asyncio.gather(*(each.destroy() for each in nodes))


ASKED = {
    "ListTasks": ("observe", {}),
    "ShowTask": ("observe", {"task_id": 1}),
    "WatchTasks": ("observe", {"timeout": 0.001}),
    "PauseTasks": ("operate", {}),
    "ReprioritiseTask": ("operate", {"task_id": 1, "priority": 3}),
    "RequeueTask": ("operate", {"task_id": 1}),
    "StopRobot": ("operate", {}),
    "ResumeTasks": ("operate", {}),
}


@pytest.mark.parametrize("type_name", ASKED)
async def test_each_service_asks_for_its_role(people, type_name):
    needed, fields = ASKED[type_name]
    for role in Role:
        name = role.name.lower()
        answer = await outcome(people[name](type_name, **fields))
        denied = isinstance(answer, str)
        assert denied is (role < Role[needed.upper()]), answer
        if denied:
            assert answer.endswith(f" needs the role {needed}; the account {name} has {name}")


async def test_observers_cannot_submit(people):
    answer = await outcome(people["observe"].submit("move", "3", 5))
    assert answer == "/robot_task needs the role submit; the account observe has observe"


@pytest.mark.parametrize("verb", ["CancelTask", "DropTask"])
async def test_submitters_change_their_own_tasks_and_operators_all(people, verb):
    for task_id, (who, allowed) in enumerate(
        [("submit", True), ("other", False), ("observe", False), ("operate", True)], 1
    ):
        assert (await people["submit"].submit("move", "3", 5)).task_id == task_id
        answer = await outcome(people[who](verb, task_id=task_id))
        assert (answer is True) is allowed, answer
        if who == "other":
            assert answer == (
                f"task {task_id} was submitted by another client: to change it, the account"
                " other needs the role operate, but it has submit"
            )


async def test_task_belongs_to_the_account_with_any_node_name(people):
    await people["submit"].submit("move", "3", 5)
    shown = await people["observe"]("ShowTask", task_id=1)
    assert shown.task.client == "submit"


async def test_no_service_of_the_task_server_has_its_role_by_accident():
    async with (
        taskrpc.Node("task_server", transport="memory") as node,
        TaskServer(node, LineRobot(), MemoryStore()),
    ):
        roles = {each.name: each.role for each in node._transport.offers.values()}
    below = {f"/robot_task/{verb}": role for verb, role in ROLES.items()}
    action = {"send_goal": Role.SUBMIT, "cancel_goal": Role.SUBMIT, "get_result": Role.OBSERVE}
    execute = {f"/robot_task/execute/_action/{name}": role for name, role in action.items()}
    assert roles == {"/robot_task": Role.SUBMIT, **below, **execute}


async def test_observers_read_services_definitions_and_health(people):
    looking = people["observe"]._node
    services = {name for entry in await looking.graph() for name in map(_name, entry.services)}
    assert {"/robot_task", "/robot_task/health", "/robot_task/stop"} <= services
    assert (await looking.definition("/robot_task/stop"))[0] == "taskrpc_interfaces/srv/StopRobot"
    trigger = srvgen.load("std_srvs/srv/Trigger")
    client = looking.create_client(trigger, "/robot_task/health")
    assert (await client.call(trigger.Request())).success


async def test_unknown_callers_get_no_information(people):
    place = people["observe"]._node._transport.network.peers()[0].text
    async with taskrpc.Node("stranger", peers=[place], token="eve.eves-secret-eves-sec") as eve:
        asked = [entry for entry in await eve.graph() if not entry.pid]  # others are the registry's
        assert asked == []
        with pytest.raises(taskrpc.AuthenticationFailed):
            await eve.definition("/robot_task")


def _name(endpoint):
    return endpoint.name


async def test_goals_of_the_action_follow_the_same_rules(people):
    ExecuteTask = srvgen.load("my_robot_interfaces/action/ExecuteTask")
    goal = ExecuteTask.Goal(task_type="move", target="3", priority=5)
    goal_id = "0123456789abcdef" * 2
    clients = {
        name: client._node.create_action_client(ExecuteTask, "/robot_task/execute")
        for name, client in people.items()
    }
    with pytest.raises(taskrpc.PermissionDenied, match="send_goal needs the role submit"):
        await clients["observe"].send_goal(goal)
    mine = await clients["submit"].send_goal(goal, goal_id=goal_id)
    same = await clients["other"].send_goal(goal, goal_id=goal_id)
    assert not await same.cancel()
    operators = await clients["operate"].send_goal(goal, goal_id=goal_id)
    assert await operators.cancel()
    with pytest.raises(taskrpc.GoalCanceled):
        await mine.result(60)
    assert (await people["submit"]("ShowTask", task_id=1)).task.client == "submit"
