import asyncio

import pytest

from taskrpc.robot.fleet.lease import LeaseKeeper, Report
from taskrpc.robot.fleet.rules import NameTaken
from taskrpc.robot.fleet.store import MemoryFleet, MemoryFleetStore
from tests.robot.fleet.fakes import robot

LEASE = 6.0


@pytest.fixture
async def database():
    loop = asyncio.get_running_loop()
    return MemoryFleet(lambda: 1000.0 + loop.time())


class Server:
    def __init__(self, database, name="a", server="one"):
        self.store = MemoryFleetStore(database)
        self.ends, self.epochs, self.report = [], [], Report()
        self.keeper = LeaseKeeper(
            self.store,
            robot(name, server=server),
            LEASE,
            report=lambda: self.report,
            on_end=lambda: self.ends.append(asyncio.get_running_loop().time()),
            on_joined=self.epochs.append,
        )


async def test_lease_is_valid_from_join_to_leave(database):
    server = Server(database)
    assert not server.keeper.is_valid
    await server.keeper.join()
    for _ in range(20):
        await asyncio.sleep(1)
        assert server.keeper.is_valid
    await server.keeper.leave()
    assert not server.keeper.is_valid
    assert database.robots["a"][1].is_gone
    assert server.ends == []


async def test_server_that_is_cut_off_ends_its_lease_before_the_database_does(database):
    server = Server(database)
    await server.keeper.join()
    server.store.is_cut_off = True
    await asyncio.sleep(20)
    [end] = server.ends
    assert 1000.0 + end < database.robots["a"][1].lease_until
    assert not server.keeper.is_valid
    server.store.is_cut_off = False
    await asyncio.sleep(1)
    assert server.keeper.is_valid
    await server.keeper.leave()


async def test_server_that_lost_its_lease_joins_again_when_its_robot_stands(database):
    server, other = Server(database), Server(database, "b")
    await server.keeper.join()
    await other.keeper.join()
    server.store.is_cut_off = True
    server.report = Report(remaining=3.0)
    await asyncio.sleep(10)
    server.store.is_cut_off = False
    await asyncio.sleep(5)
    assert not server.keeper.is_valid
    server.report = Report()
    await asyncio.sleep(2)
    assert server.keeper.is_valid
    assert server.epochs[0] < server.epochs[1]
    await server.keeper.leave()
    await other.keeper.leave()


async def test_second_robot_of_a_name_is_refused_while_the_first_one_renews(database):
    first, second = Server(database), Server(database, server="two")
    await first.keeper.join()
    with pytest.raises(NameTaken, match="--robot-name"):
        await second.keeper.join()
    await first.keeper.leave()


async def test_server_waits_for_the_lease_of_a_crashed_one(database):
    crashed, second = Server(database), Server(database, server="two")
    await crashed.keeper._join()  # and never again
    await second.keeper.join()
    assert asyncio.get_running_loop().time() == pytest.approx(LEASE + 0.1)
    await second.keeper.leave()
    crashed.keeper._watchdog.cancel()


async def test_name_that_another_server_has_taken_is_logged_once(database, caplog):
    first, second = Server(database), Server(database, server="two")
    await first.keeper.join()
    first.store.is_cut_off = True
    await asyncio.sleep(LEASE)
    await second.keeper.join()
    caplog.clear()
    first.store.is_cut_off = False
    await asyncio.sleep(20)
    assert caplog.text.count("is not renewed: another server drives 'a'") == 1
    await second.keeper.leave()
    await asyncio.sleep(1)
    assert first.keeper.is_valid
    await first.keeper.leave()
