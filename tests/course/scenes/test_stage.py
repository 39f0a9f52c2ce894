"""The stage of a scene: its private folders, and what the robot reports."""

import logging
import os

import pytest

import srvgen
from taskrpc import DeadlineExceeded, Node
from taskrpc.course.scenes.catalogue import scene
from taskrpc.course.scenes.stage import open_stage, private_folders, reported_log

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")


def test_folders_are_private_and_empty_and_restored(monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", "/mine")
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("TASKRPC_PEERS", "robot:7000")
    with private_folders() as folder:
        assert list(folder.iterdir()) == []
        assert os.environ["XDG_STATE_HOME"] == os.environ["XDG_RUNTIME_DIR"] == str(folder.parent)
        assert "TASKRPC_PEERS" not in os.environ
    assert not folder.exists()
    assert os.environ["XDG_STATE_HOME"] == "/mine"
    assert os.environ["TASKRPC_PEERS"] == "robot:7000"
    assert "XDG_RUNTIME_DIR" not in os.environ


def test_log_is_reported_instead_of_printed(caplog):
    seen = []
    with reported_log(lambda *what: seen.append(what)):
        logging.getLogger("taskrpc.tasks").info("Executing task %d: report - central", 4)
    logging.getLogger("taskrpc.tasks").info("Executing task %d: report - central", 5)
    assert seen == [("robot", "executes task 4")]
    assert caplog.messages == []


@pytest.mark.labs
@pytest.mark.real_time
async def test_robot_reports_calls_faults_and_tasks():
    seen = []
    request = RobotTask.Request(task_type="report", target="central", priority=5)
    async with open_stage(scene("lost-reply"), lambda *what: seen.append(what)) as stage:
        async with Node("operator") as node:
            client = node.create_client(RobotTask, "/robot_task")
            assert await client.wait_for_service(timeout=5.0)
            with pytest.raises(DeadlineExceeded):
                await client.call(request, timeout=0.2, request_id="monday-1")
            assert (await client.call(request, request_id="monday-1")).task_id == 1
        await stage.rest(3.0)
    texts = [text for _, text in seen]
    assert [text for text in texts if text.startswith("call")] == [
        "call 1: the request arrives",
        "call 1: the response is lost",
        "call 2: the request arrives",
        "call 2: the stored response is sent",
    ]
    assert texts.count("executes task 1") == 1


async def test_scene_without_a_robot_needs_no_server():
    seen = []
    async with open_stage(scene("deadlock"), lambda *what: seen.append(what)) as stage:
        assert list(stage.folder.iterdir()) == []
        await stage.rest(1.0)
    assert seen == []
