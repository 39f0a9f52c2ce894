"""Callers learn that a store failed and why; the paths of its files stay in the server's log."""

import contextlib
import os
import sqlite3

import pytest

import srvgen
import taskrpc
from taskrpc import SqliteCompletions
from taskrpc.robot.tasks import SqliteStore, TaskServer
from tests.core.transport.helpers import outcome
from tests.robot.tasks.fakes import LineRobot
from tests.robot.tasks.test_server import Client

pytestmark = pytest.mark.real_time

Trigger = srvgen.load("std_srvs/srv/Trigger")


@pytest.fixture
def path(tmp_path):
    (tmp_path / "My Robots").mkdir()
    return tmp_path / "My Robots" / "tasks.db"


def respond(request, response):
    return response


def said(answer):
    """All that an answer, or an error, says."""
    return str(answer) if isinstance(answer, Exception) else answer.message


async def everything(node):
    """What each service answers that needs the store."""
    client = Client(node)
    health = node.create_client(Trigger, "/robot_task/health")
    return [
        await outcome(client.submit("move", "3", 5)),
        await outcome(client("CancelTask", task_id=1)),
        await outcome(client("PauseTasks")),
        await outcome(client("ResumeTasks")),
        await outcome(client("StopRobot")),
        await outcome(health.call(Trigger.Request())),
    ]


@pytest.mark.skipif(os.name != "posix", reason="a file in use cannot be removed on Windows")
async def test_no_answer_names_a_file_of_the_servers(path, caplog):
    async with (
        taskrpc.Node("task_server") as node,
        TaskServer(node, LineRobot(), SqliteStore(path)) as server,
    ):
        await server.manager.pause()
        assert (await outcome(Client(node).submit("move", "3", 5))).success
        path.rename(path.with_name("elsewhere"))
        answers = [said(each) for each in await everything(node)]
        path.with_name("elsewhere").rename(path)
    assert all("was removed or replaced while it was in use" in each for each in answers), answers
    assert "the server's file was removed" in answers[0]
    for word in (str(path), "My Robots", "tasks.db", os.sep):
        assert not any(word in each for each in answers), answers
    assert str(path) in caplog.text


@pytest.mark.skipif(os.name != "posix", reason="another program changes a file in use")
async def test_no_task_is_acknowledged_after_the_servers_file_was_truncated(path, caplog):
    async with (
        taskrpc.Node("task_server") as node,
        TaskServer(node, LineRobot(), SqliteStore(path)),
    ):
        client = Client(node)
        assert (await outcome(client.submit("move", "3", 5))).success
        os.truncate(path, 0)
        answers = [said(await outcome(client.submit("move", str(x), 5))) for x in range(4)]
    assert all("nothing was stored; start the server again" in each for each in answers), answers
    assert "tasks.db was changed by another program while it was in use (expected" in caplog.text


class Late:
    """A store that does not open its file before its service is offered."""

    def __init__(self, path):
        store = SqliteCompletions(path)
        self.recall, self.complete = store.recall, store.complete


async def test_error_of_an_unopened_store_hides_its_path(path, caplog):
    path.write_bytes(b"no database at all, but long enough" * 100)
    async with (
        taskrpc.Node("server", token="one") as node,
        taskrpc.Node("client", token="other") as laptop,
    ):
        node.create_service(Trigger, "ask", respond, exactly_once=Late(path))
        client = laptop.create_client(Trigger, "ask", timeout=5)
        answer = said(await outcome(client.call(Trigger.Request())))
    assert "expected a database, found another file" in answer
    assert "tasks.db" not in answer
    assert "My Robots" not in answer
    assert str(path) in caplog.text


def ruin(path):
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("ALTER TABLE taskrpc_completion RENAME COLUMN principal TO person")


async def test_task_server_with_wrong_tables_offers_nothing(path, monkeypatch):
    monkeypatch.setattr(TaskServer, "_offer", lambda *_, **__: pytest.fail("it was offered"))
    store = SqliteStore(path)
    await store.load()
    await store.close()
    ruin(path)
    async with taskrpc.Node("task_server") as node:
        with pytest.raises(taskrpc.TaskRpcError, match="the table taskrpc_completion is not"):
            await TaskServer(node, LineRobot(), SqliteStore(path)).start()


@pytest.mark.parametrize("problem", ["tables", "schema", "contents"])
async def test_service_with_a_store_that_cannot_be_used_is_not_offered(path, problem):
    schema = []
    if problem == "contents":
        path.write_bytes(b"no database at all, but long enough" * 100)
    elif problem == "schema":
        schema = ["CREATE TABEL seat (number INTEGER)"]
    else:
        store = SqliteCompletions(path)
        await store.recall()
        await store.close()
        ruin(path)
    async with taskrpc.Node("server") as node:
        store = SqliteCompletions(path, schema)
        with pytest.raises(taskrpc.StoreError, match=r"tasks\.db"):
            node.create_service(Trigger, "ask", respond, exactly_once=store)
        assert not node.status().services
        path.unlink()
        path.with_name("tasks.db.lock").unlink()
        right = SqliteCompletions(path)  # the first store has released the file
        node.create_service(Trigger, "ask", respond, exactly_once=right)
    await store.close()
    await right.close()
