"""The buttons of the page call the public services, as every other client does."""

import asyncio
import json

import pytest

import taskrpc
from taskrpc.core.security.roles import Account, Accounts, Role
from taskrpc.observe.web import control
from taskrpc.observe.web.control import Control
from taskrpc.observe.web.tokens import Holder
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.robot.tasks.services.offered_tasks import load_types
from tests.robot.tasks.fakes import LineRobot

SECRET = "s" * 20
ACCOUNTS = Accounts(
    [
        Account("ada", SECRET, Role.SUBMIT),
        Account("olga", SECRET, Role.OPERATE),
        *(Account(f"s{number}", SECRET) for number in range(20)),
    ]
)
OWNER = Holder("")
TYPES = load_types()


def account(name):
    return Holder(name, f"{name}.{SECRET}")


class System:
    """A task server in memory, and the control of its page."""

    def __init__(self):
        self.made = []

    async def __aenter__(self):
        self.node = taskrpc.Node("task_server", transport="memory", accounts=ACCOUNTS)
        await self.node.start()
        self.server = TaskServer(self.node, LineRobot(), MemoryStore())
        await self.server.start()
        self.control = Control(TYPES, self.make_node)
        return self

    async def __aexit__(self, *_):
        await self.control.close()
        await self.server.close()
        await self.node.destroy()

    def make_node(self, token):
        node = taskrpc.Node(control.NODE, transport="memory", token=token or None)
        self.made.append(node)
        return node

    async def post(self, verb, fields=None, holder=OWNER, content_type="application/json"):
        body = b"" if fields is None else json.dumps(fields).encode()
        return await self.post_raw(verb, body, holder, content_type)

    async def post_raw(self, verb, body, holder=OWNER, content_type="application/json"):
        page = await self.control.answer(verb, content_type, body, holder)
        assert page.content_type == "application/json"
        return page.status, json.loads(page.body)


@pytest.fixture
async def system():
    async with System() as made:
        yield made


MOVE = {"task_type": "move", "target": "9", "priority": 5}


async def test_every_button_does_what_its_service_does(system):
    status, said = await system.post("submit", MOVE)
    assert (status, said["success"], said["task_id"]) == (200, True, 1)
    await system.post("submit", MOVE)
    await asyncio.sleep(0.5)
    manager = system.server.manager
    assert (await system.post("reprioritise", {"task_id": 2, "priority": 8}))[1]["success"]
    assert manager.queue.find(2).priority == 8
    assert (await system.post("pause"))[1]["success"]
    assert manager.is_paused
    assert (await system.post("resume", {}))[1]["success"]
    assert not manager.is_paused
    assert (await system.post("cancel", {"task_id": 2}))[1]["success"]
    assert (await system.post("requeue", {"task_id": 2}))[1]["success"]
    assert (await system.post("drop", {"task_id": 2}))[1]["success"]
    assert (await system.post("stop"))[1]["success"]
    assert manager.repository.find(1).state.value == "CANCELED"
    assert len(system.made) == 1


async def test_refusal_of_the_service_is_no_error(system):
    status, said = await system.post("submit", MOVE | {"task_type": "fly"})
    assert status == 200
    assert said["success"] is False
    assert said["message"].startswith("Invalid task: fly")


async def test_task_of_the_page_has_its_client_or_its_account(system):
    await system.post("submit", MOVE)
    await system.post("submit", MOVE, account("ada"))
    clients = [system.server.manager.repository.find(number).client for number in (1, 2)]
    assert clients == ["/web_page", "ada"]


async def test_account_may_do_only_what_its_role_allows(system):
    await system.post("submit", MOVE)
    status, said = await system.post("pause", {}, account("ada"))
    assert (status, said["error"]) == (403, "PermissionDenied")
    assert said["message"].startswith("/robot_task/pause needs the role operate")
    status, said = await system.post("cancel", {"task_id": 1}, account("ada"))
    assert (status, said["error"]) == (403, "PermissionDenied")
    assert (await system.post("pause", {}, account("olga")))[0] == 200


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (b"{", "expected a JSON object"),
        (b'{"task_type": ' + b"[" * 3000 + b"]" * 3000 + b"}", "expected"),
        (b"[" * 30_000, "expected a JSON object"),
        (b"[1]", "expected a JSON object, got list"),
        (b"\xff", "expected a JSON object"),
        (b'{"priority": "x"}', "priority: expected int32, got 'x' (str)"),
        (b'{"priority": 3000000000}', "priority: expected"),
        (b'{"priorty": 1}', "did you mean 'priority'?"),
        (b" " * (control.MAX_BODY + 1), "expected a body of at most"),
    ],
)
async def test_bad_request_gets_one_sentence_and_makes_no_call(system, body, problem):
    status, said = await system.post_raw("submit", body)
    assert status == 400
    assert problem in said["message"]
    assert not system.made


@pytest.mark.parametrize("content_type", ["", "text/plain", "application/x-www-form-urlencoded"])
async def test_other_content_types_are_refused(system, content_type):
    status, said = await system.post("pause", {}, content_type=content_type)
    assert status == 400
    assert "expected the Content-Type application/json" in said["message"]
    assert not system.server.manager.is_paused


@pytest.mark.parametrize("verb", ["", "list", "health", "../pause", "pause/x"])
async def test_other_verbs_are_unknown(system, verb):
    assert (await system.post(verb))[0] == 404


async def test_server_that_is_gone_is_reported(system):
    await system.node.destroy()
    status, said = await system.post("pause")
    assert status in (503, 504)
    assert said["error"] in ("ServiceUnavailable", "DeadlineExceeded")


async def test_unused_node_is_closed_and_made_again(system):
    await system.post("pause")
    await asyncio.sleep(control.IDLE_SECONDS / 2)
    await system.post("resume")
    assert len(system.made) == 1
    await asyncio.sleep(2 * control.IDLE_SECONDS + 1)
    await system.post("pause")
    assert len(system.made) == 2


async def test_least_recently_used_node_makes_room_for_a_new_one(system):
    for number in range(control.MAX_NODES):
        await system.post("submit", MOVE, account(f"s{number}"))
    await system.post("submit", MOVE, account("s0"))
    assert len(system.made) == control.MAX_NODES
    await system.post("submit", MOVE, account("ada"))
    await system.post("submit", MOVE, account("s0"))
    assert len(system.made) == control.MAX_NODES + 1
    await system.post("submit", MOVE, account("s1"))
    assert len(system.made) == control.MAX_NODES + 2


async def test_too_many_users_at_once_are_refused(system, monkeypatch):
    monkeypatch.setattr(control, "MAX_NODES", 1)
    pending = asyncio.create_task(system.post("submit", MOVE))
    while not system.made:
        await asyncio.sleep(0)
    await asyncio.sleep(0)
    status, said = await system.post("submit", MOVE, account("ada"))
    assert (status, said["error"]) == (503, "ServerBusy")
    assert (await pending)[0] == 200
