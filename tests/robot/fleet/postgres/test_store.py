"""The fleet's store in a real PostgreSQL."""

import asyncio
import time

import pytest

from taskrpc.core.request_ids.ids import Completion
from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.store import AlreadyCompleted
from tests.faults.postgres_proxy import CUT, SWALLOW, PostgresProxy
from tests.robot.fleet.fakes import robot, task
from tests.robot.tasks.records.store_rules import HistoryRules, Opened, StoreRules, ended

psycopg = pytest.importorskip("psycopg")

from taskrpc.robot.fleet.postgres.archive import PostgresEndedTasks  # noqa: E402
from taskrpc.robot.fleet.postgres.connection import DatabaseUrl, close  # noqa: E402
from taskrpc.robot.fleet.postgres.schema import VERSION  # noqa: E402
from taskrpc.robot.fleet.postgres.store import PostgresStore  # noqa: E402

pytestmark = [pytest.mark.postgres, pytest.mark.real_time]


@pytest.fixture
async def store(postgres_url):
    store = PostgresStore(postgres_url)
    yield store
    await store.close()


class TestPostgresStore(StoreRules):
    pass


class TestHistoryInPostgres(HistoryRules):
    @pytest.fixture
    async def opened(self, postgres_url):
        used = []

        async def opened(history):
            store = PostgresStore(postgres_url, history=history)
            used.extend((store, source := PostgresEndedTasks(postgres_url)))
            return Opened(store, lambda *tasks: store.apply(tasks), source)

        yield opened
        for each in used:
            await each.close()


async def test_ended_tasks_are_not_read_from_a_database_without_a_fleet(postgres_url):
    source = PostgresEndedTasks(postgres_url)
    problem = f"expected the tables of a fleet of version {VERSION}, found version 0"
    with pytest.raises(StoreError, match=problem):
        await source.recent()
    await source.close()


async def test_ended_tasks_are_read_while_a_transaction_holds_the_fleet(postgres_url, store):
    await store.apply([ended(1, 5.0)])
    connection = await DatabaseUrl(postgres_url).connect("test")
    await connection.execute("BEGIN")
    await connection.execute("SELECT 1 FROM taskrpc_fleet FOR UPDATE")
    source = PostgresEndedTasks(postgres_url)
    assert await source.recent() == [ended(1, 5.0)]
    await source.close()
    await close(connection)


def put(number):
    return lambda state, now: state.put_task(task(number))


async def until(condition, seconds=10):
    async with asyncio.timeout(seconds):
        while not condition():
            await asyncio.sleep(0.01)


async def test_changes_of_one_server_reach_the_others_at_once(postgres_url, store, monkeypatch):
    monkeypatch.setattr("taskrpc.robot.fleet.postgres.store.POLL", 60.0)
    other = PostgresStore(postgres_url)
    await other.refresh()
    await asyncio.sleep(0.5)
    await store.transact(put(1))
    await until(lambda: 1 in other.state.tasks, 5)
    await other.close()


async def test_each_of_many_concurrent_transactions_sees_all_earlier_ones(postgres_url):
    stores = [PostgresStore(postgres_url) for _ in range(4)]

    def take(state, now):
        state.set_meta(next_id=state.meta.next_id + 1)
        return state.meta.next_id

    async def taken(store):
        return [await store.transact(take) for _ in range(20)]

    found = await asyncio.gather(*(taken(store) for store in stores))
    assert sorted(each for some in found for each in some) == list(range(2, 82))
    await asyncio.gather(*(store.close() for store in stores))


async def test_database_clock_counts_whatever_the_machines_clock_says(store, monkeypatch):
    monkeypatch.setattr(time, "time", lambda: 1.0)
    before = (await store.transact(lambda state, now: now)), store.now()
    assert min(before) > 1e9
    assert abs(before[0] - before[1]) < 5


async def test_completed_request_is_found_by_another_server(postgres_url, store):
    done = Completion("ann", b"c" * 16, 7, 7, b"f", b"response", 0, 1.0)
    key = "ann", b"c" * 16, 7

    def action(state, now):
        state.complete(done)

    await store.transact(action, key)
    other = PostgresStore(postgres_url)
    assert await other.look_up(key[:2]) == [done]
    with pytest.raises(AlreadyCompleted) as caught:
        await other.transact(action, key)
    assert caught.value.completion == done
    await other.close()


async def test_completions_of_a_client_are_forgotten_a_day_after_its_last_request(
    postgres_url, store
):
    for number, client in enumerate((b"a" * 16, b"b" * 16)):
        done = Completion("ann", client, 1, 1, b"f", b"", 0, float(number))
        await store.apply([], completion=done)
    with psycopg.connect(postgres_url, autocommit=True) as connection:
        connection.execute(
            "UPDATE taskrpc_completion SET stored_at = stored_at - interval '25 hours'"
            " WHERE client = %s",
            ((b"a" * 16).hex(),),
        )
    await store.forget_old_clients()
    assert [each.client for each in (await store.load()).completions] == [b"b" * 16]


async def test_damaged_completion_is_reported_with_its_row(postgres_url, store):
    done = Completion("ann", b"c" * 16, 7, 7, b"f", b"response", 0, 1.0)
    await store.apply([], completion=done)
    with psycopg.connect(postgres_url, autocommit=True) as connection:
        connection.execute("UPDATE taskrpc_completion SET record = replace(record, 'ann', 'bob')")
    with pytest.raises(StoreError, match=r"the checksum does not match WHERE client = '6363"):
        await store.load()


async def test_statement_that_fails_changes_nothing(store):
    await store.apply([task(1)])
    with pytest.raises(StoreError, match="did not store anything"):
        await store.apply([task(2), task(2**70)], [1])
    assert [each.task_id for each in (await store.load()).tasks] == [1]


async def test_transaction_is_repeated_when_the_database_was_restarted(own_cluster, monkeypatch):
    # A busy machine may need long for the recovery.
    monkeypatch.setattr("taskrpc.robot.fleet.postgres.store.PATIENCE", 60.0)
    store = PostgresStore(own_cluster.url())
    await store.transact(put(1))
    own_cluster.kill()
    changing = store.transact(put(2))
    await asyncio.sleep(0.3)
    await asyncio.to_thread(own_cluster.start)
    await changing
    assert sorted(each.task_id for each in (await store.load()).tasks) == [1, 2]
    await store.close()


async def test_copy_follows_a_replica_that_lacks_the_newest_transactions(own_cluster):
    store = PostgresStore(own_cluster.url(), listen=False)
    for number in (1, 2, 3):
        await store.transact(put(number))
    # As after a failover: transactions 2 and 3 are lost, and others have their numbers.
    own_cluster.execute("DELETE FROM taskrpc_task WHERE task_id IN (2, 3)")
    other = PostgresStore(own_cluster.url(), listen=False)
    own_cluster.execute("UPDATE taskrpc_fleet SET revision = 1")
    for number in (7, 8, 9):
        await other.transact(put(number))
    own_cluster.kill()
    await asyncio.to_thread(own_cluster.start)
    await store.refresh()
    assert sorted(store.state.tasks) == [1, 7, 8, 9]
    await store.close()
    await other.close()


async def test_database_that_is_created_again_is_not_filled_without_the_operator(own_cluster):
    own_cluster.execute("CREATE DATABASE fleet")
    store = PostgresStore(own_cluster.url("fleet"))
    await store.transact(put(1))
    own_cluster.execute("DROP DATABASE fleet WITH (FORCE)")
    with pytest.raises(StoreError, match=r'database "fleet" does not exist; create it with'):
        await store.refresh()
    own_cluster.execute("CREATE DATABASE fleet")
    with pytest.raises(StoreError, match=r"were deleted while this server ran: restore a backup"):
        await store.transact(put(2))
    assert sorted(store.state.tasks) == [1]  # lists still show the last known tasks
    await store.close()
    again = PostgresStore(own_cluster.url("fleet"), listen=False)
    await again.transact(put(2))
    assert sorted((await again.load()).tasks) == [task(2)]
    await again.close()


async def test_copy_is_read_at_once_when_the_database_was_restarted(own_cluster):
    store = PostgresStore(own_cluster.url())
    await store.transact(put(1))
    own_cluster.kill()
    await asyncio.to_thread(own_cluster.start)
    assert await store.follow(10) == ""
    await store.close()


async def test_database_that_stays_away_is_reported_and_nothing_is_stored(own_cluster, monkeypatch):
    monkeypatch.setattr("taskrpc.robot.fleet.postgres.store.PATIENCE", 0.5)
    store = PostgresStore(own_cluster.url())
    await store.transact(put(1))
    own_cluster.kill()
    with pytest.raises(StoreError, match="start PostgreSQL there"):
        await store.transact(put(2))
    await asyncio.to_thread(own_cluster.start)
    assert [each.task_id for each in (await store.load()).tasks] == [1]
    await store.close()


async def test_paused_process_does_not_keep_the_fleets_lock(postgres_url, store):
    await store.store_id()
    paused = psycopg.connect(postgres_url)
    paused.execute("SET idle_in_transaction_session_timeout = '1s'")
    paused.execute("SELECT 1 FROM taskrpc_fleet FOR UPDATE")
    await store.transact(put(1))  # waits until PostgreSQL has ended the other session
    assert 1 in store.state.tasks
    paused.close()


async def test_record_that_cannot_be_read_stops_the_server_instead_of_being_passed_over(
    postgres_url, store
):
    await store.transact(put(1))
    with psycopg.connect(postgres_url) as connection:
        connection.execute("UPDATE taskrpc_task SET record = '{}', revision = 9")
        connection.execute("UPDATE taskrpc_fleet SET revision = 9")
    for _ in range(2):
        with pytest.raises(StoreError, match=r"cannot be read: .*restore a backup"):
            await store.refresh()
        with pytest.raises(StoreError, match=r"cannot be read: .*restore a backup"):
            await store.transact(put(2))


async def test_fleet_without_its_row_is_explained(postgres_url, store):
    await store.transact(put(1))
    with psycopg.connect(postgres_url) as connection:
        connection.execute("DELETE FROM taskrpc_fleet")
    with pytest.raises(StoreError, match="expected one row; restore it"):
        await store.transact(put(2))


@pytest.mark.parametrize(("first_hours", "second_hours"), [(5, -7), (-7, 5)])
async def test_leases_of_servers_with_wrong_clocks_end_by_the_databases_clock(
    postgres_url, monkeypatch, first_hours, second_hours
):
    wall = time.time
    stores, ends = [PostgresStore(postgres_url) for _ in range(2)], []
    for name, store, hours in zip("ab", stores, (first_hours, second_hours), strict=True):
        monkeypatch.setattr(time, "time", lambda hours=hours: wall() + hours * 3600)

        def action(state, now, name=name):
            ends.append(rules.join(state, now, robot(name), 6.0).lease_until)
            return [each.name for each in state.live_robots(now)]

        live = await store.transact(action)
    monkeypatch.setattr(time, "time", wall)
    assert live == ["a", "b"]
    assert abs(ends[0] - ends[1]) < 60
    for store in stores:
        assert abs(store.now() - ends[1]) < 60
        await store.close()


# Commits without an answer


@pytest.fixture
async def proxy(shared_cluster):
    async with PostgresProxy(shared_cluster.port) as proxy:
        yield proxy


@pytest.fixture
async def proxied(postgres_url, shared_cluster, proxy, monkeypatch):
    """A store behind the proxy, which has task 1; it waits briefly for a database that is away."""
    url = postgres_url.replace(f":{shared_cluster.port}/", f":{proxy.port}/")
    store = PostgresStore(url, listen=False)
    await store.apply([task(1)])
    monkeypatch.setattr("taskrpc.robot.fleet.postgres.store.PATIENCE", 0.1)
    yield store
    await store.close()


async def test_copy_is_read_again_after_a_commit_of_unknown_outcome(proxied, proxy):
    proxy.arm(CUT, away=True)
    with pytest.raises(OutcomeUnknown, match="the connection was lost during a commit"):
        await proxied.apply([task(2)])
    assert sorted(proxied.state.tasks) == [1], "the last state that is known"
    proxy.is_away = False
    await proxied.refresh()
    assert sorted(proxied.state.tasks) == [1, 2]


async def test_standby_cannot_say_that_a_commit_took_no_effect(
    proxied, proxy, postgres_url, shared_cluster
):
    setting = f"ALTER DATABASE {postgres_url.rpartition('/')[2]} SET default_transaction_read_only"
    shared_cluster.execute(f"{setting} = on")  # of new sessions, as on a standby
    proxy.arm(CUT)
    with pytest.raises(OutcomeUnknown, match="read-only transaction"):
        await proxied.apply([task(2)])
    shared_cluster.execute(f"{setting} = off")
    assert [each.task_id for each in (await proxied.load()).tasks] == [1, 2]


async def test_number_that_may_be_forgotten_leaves_the_outcome_unknown(
    proxied, proxy, postgres_url, monkeypatch
):
    monkeypatch.setattr("taskrpc.robot.fleet.postgres.store._BATCHES_KEPT", 0.0)
    with psycopg.connect(postgres_url, autocommit=True) as other:
        other.execute("DELETE FROM taskrpc_writer")
    proxy.arm(SWALLOW)
    with pytest.raises(OutcomeUnknown, match="the check came too late"):
        await proxied.apply([task(2)])


async def test_store_is_used_on_after_it_was_cleared_without_an_answer(proxied, proxy):
    proxy.arm(CUT)
    await proxied.clear()
    await proxied.apply([task(1)])
    assert [each.task_id for each in (await proxied.load()).tasks] == [1]


async def test_cancelled_check_of_a_commit_leaves_a_store_that_works(proxied, proxy):
    proxy.arm(CUT, away=True)
    changing = proxied.apply([task(2)])
    while not proxy.is_away:
        await asyncio.sleep(0.01)
    proxied._writing.cancel()
    with pytest.raises(OutcomeUnknown, match="the server ended"):
        await changing
    assert sorted(proxied.state.tasks) == [1]
    proxy.is_away = False
    await proxied.apply([task(3)])
    assert [each.task_id for each in (await proxied.load()).tasks] == [1, 2, 3]
