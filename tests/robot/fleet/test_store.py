import asyncio

import pytest

from taskrpc.core.request_ids.ids import Completion
from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.robot.fleet.store import AlreadyCompleted, MemoryFleet, MemoryFleetStore
from tests.robot.fleet.fakes import robot, task

DONE = Completion("ann", b"c" * 16, 1, 1, b"f", b"response", 0, 1.0)


@pytest.fixture
def database():
    return MemoryFleet(lambda: 1000.0)


@pytest.fixture
def stores(database):
    return [MemoryFleetStore(database) for _ in range(2)]


def put(number):
    def action(state, now):
        state.put_task(task(number))
        return number, now

    return action


async def test_action_changes_the_copies_of_all_servers(stores):
    first, second = stores
    assert await first.transact(put(1)) == (1, 1000.0)
    await asyncio.sleep(1)
    assert list(second.state.tasks) == [1]
    assert first.state.meta == second.state.meta


async def test_action_sees_what_another_server_has_changed_just_before(stores):
    first, second = stores
    second.gets_notifications = False
    await first.transact(put(1))
    assert await second.transact(lambda state, now: list(state.tasks)) == [1]


async def test_action_that_fails_changes_nothing_and_only_its_caller_gets_the_error(stores):
    first, second = stores

    def fails(state, now):
        state.put_task(task(2))
        raise ValueError("no")

    before, failing, after = (first.transact(each) for each in (put(1), fails, put(3)))
    with pytest.raises(ValueError, match="no"):
        await failing
    await asyncio.gather(before, after)
    await second.refresh()
    assert sorted(second.state.tasks) == [1, 3]


async def test_actions_that_wait_together_share_a_transaction(database, stores):
    await asyncio.gather(*(stores[0].transact(put(number)) for number in range(1, 10)))
    assert database.meta.revision == 1


async def test_action_that_changes_nothing_makes_no_revision(database, stores):
    await stores[0].transact(lambda state, now: None)
    assert database.meta.revision == 0


async def test_request_that_another_server_has_completed_does_not_run_again(stores):
    first, second = stores
    key = DONE.principal, DONE.client, DONE.sequence

    def action(state, now):
        state.put_task(task(len(state.tasks) + 1))
        state.complete(DONE)

    await first.transact(action, key)
    with pytest.raises(AlreadyCompleted) as caught:
        await second.transact(action, key)
    assert caught.value.completion == DONE
    assert list(second.state.tasks) == [1]
    assert await second.look_up(("ann", b"c" * 16)) == [DONE]


async def test_request_that_waits_twice_runs_once(stores):
    key = DONE.principal, DONE.client, DONE.sequence
    ran = []

    def action(state, now):
        ran.append(now)
        state.complete(DONE)

    first, second = stores[0].transact(action, key), stores[0].transact(action, key)
    await first
    with pytest.raises(AlreadyCompleted):
        await second
    assert len(ran) == 1


async def test_unreachable_database_changes_nothing(database, stores):
    stores[0].is_cut_off = True
    with pytest.raises(StoreError, match="cannot be reached"):
        await stores[0].transact(put(1))
    assert not database.tasks
    assert not stores[0].state.tasks


async def test_lost_commit_is_not_taken_for_a_failure(database, stores):
    stores[0].loses_commit = True
    with pytest.raises(OutcomeUnknown):
        await stores[0].transact(put(1))
    assert list(database.tasks) == [1]
    await stores[0].refresh()
    assert list(stores[0].state.tasks) == [1]


async def test_listeners_get_the_changed_tasks(stores):
    heard = []
    stores[1].listeners.append(heard.append)
    await stores[0].transact(put(4))
    await stores[0].transact(lambda state, now: state.put_robot(robot("a")))
    await asyncio.sleep(1)
    assert heard == [[4], []]


async def test_tasks_of_a_fleet_that_runs_are_not_cleared(stores):
    await stores[0].transact(lambda state, now: state.put_robot(robot("a")))
    with pytest.raises(StoreError, match="other servers of the fleet use these tasks: a"):
        await stores[0].clear()


async def test_copy_is_read_although_a_transaction_waits_for_the_database(stores):
    first, second = stores
    first.latency = 60.0
    changing = first.transact(put(1))
    await asyncio.sleep(1)
    assert await first.follow(0.5) == "the database does not answer"
    await changing
    assert await first.follow(100) == ""
    assert await second.follow(0.5) == ""
    second.is_cut_off = True
    assert await second.follow(0.5) == "the database cannot be reached"
