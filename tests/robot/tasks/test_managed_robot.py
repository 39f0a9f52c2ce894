import asyncio

import pytest

from taskrpc.robot.fleet import FleetManager, MemoryFleet, MemoryFleetStore
from taskrpc.robot.tasks import MemoryStore
from taskrpc.robot.tasks.managed_robot import ManagedRobot
from taskrpc.robot.tasks.manager import TaskManager
from tests.robot.tasks.fakes import LineRobot

MANAGERS = {
    "one robot": lambda robot: TaskManager(robot, MemoryStore()),
    "a fleet": lambda robot: FleetManager(
        robot, MemoryFleetStore(MemoryFleet(asyncio.get_running_loop().time))
    ),
}


@pytest.fixture(params=MANAGERS)
async def manager(request):
    manager = MANAGERS[request.param](LineRobot(speed=2.0))
    await manager.start()
    yield manager
    await manager.close()
    assert manager.is_closed


async def test_manager_reports_its_robot_and_its_running_task(manager):
    assert (manager.speed, manager.running, manager.remaining()) == (2.0, None, 0.0)
    await manager.submit("move", "10", 5)
    await asyncio.sleep(3)
    assert manager.running.task_id == 1
    assert manager.remaining() > 0
    assert 0 < manager.pose().x < 10
    assert manager.telemetry().pose == manager.pose()
    assert isinstance(manager.robot, LineRobot)


def test_neither_manager_has_its_own_version_of_what_both_share():
    shared = {name for name in vars(ManagedRobot) if not name.startswith("_")}
    assert shared >= {"robot", "speed", "running", "remaining", "pose", "telemetry"}
    for kind in (TaskManager, FleetManager):
        assert not shared & set(vars(kind))
