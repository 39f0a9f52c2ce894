"""The store of a fleet in PostgreSQL.

One row, `taskrpc_fleet`, is the fleet's lock. Every transaction locks it first, so transactions run
one after the other and their revisions are in the order of their commits: a server that reads all
rows above its last revision misses nothing. Each transaction takes two round trips: lock and read,
then write and commit.

NOTIFY wakes the other servers. Because a notification can be lost, each server also looks after
`POLL` seconds. If a connection is lost during a COMMIT, the store connects again and looks for the
number of the transaction in `taskrpc_writer`: it is there only if the transaction took effect. So
each attempt takes a number of its own. An attempt whose outcome stays unknown may have stored its
number, and the next attempt must not find that one.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
from collections.abc import Sequence
from typing import Any

import msgspec

from taskrpc.errors import OutcomeUnknown, StoreError, TaskRpcError
from taskrpc.robot.fleet.model import Meta, RobotRecord
from taskrpc.robot.fleet.postgres.connection import (
    FAILURES,
    Connection,
    DatabaseUrl,
    answered,
    check_pooling,
    close,
    is_lost,
)
from taskrpc.robot.fleet.postgres.schema import check_version, prepare
from taskrpc.robot.fleet.state import Changes
from taskrpc.robot.fleet.store import FleetStore, Outcome, Pending, RequestKey, carry_out
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.history import AT_ONCE, DEFAULT, History
from taskrpc.spi import (
    CLIENT_LEASE,
    ClientKey,
    Completion,
    CompletionBatch,
    Damaged,
    read_records,
)

log = logging.getLogger("taskrpc.fleet")

POLL = 1.0
"""Seconds after which a server looks for changes of which it got no notification."""
PATIENCE = 5.0
"""Seconds for which a transaction is tried again while the database cannot be reached."""
_RETRY_AFTER = 0.2
_ENDING_LOOKS = 300
_CHANNEL = "taskrpc_fleet"

_LOCK = "SELECT version, store_id, revision, record FROM taskrpc_fleet FOR UPDATE"
_LOOK = "SELECT version, store_id, revision, record FROM taskrpc_fleet"
_CLOCK = "SELECT extract(epoch FROM clock_timestamp())::float8"
_TASKS = "SELECT record FROM taskrpc_task WHERE revision > %s ORDER BY revision, task_id"
_ROBOTS = "SELECT record FROM taskrpc_robot WHERE revision > %s"
_COMPLETED = """
    SELECT client, sequence, record, checksum FROM taskrpc_completion
    WHERE (principal, client, sequence) IN (
        SELECT * FROM unnest(%s::text[], %s::text[], %s::text[])
    )
"""
_OF_CLIENTS = """
    SELECT client, sequence, record, checksum FROM taskrpc_completion
    WHERE (principal, client) IN (SELECT * FROM unnest(%s::text[], %s::text[]))
"""
_ALL_COMPLETIONS = """
    SELECT client, sequence, record, checksum FROM taskrpc_completion
    ORDER BY principal COLLATE "C", client COLLATE "C", sequence COLLATE "C"
"""
_SAVE_META = "UPDATE taskrpc_fleet SET revision = %s, record = %s"
_SAVE_TASKS = """
    INSERT INTO taskrpc_task (task_id, revision, state, robot, record)
    SELECT task_id, %s, state, robot, record
    FROM unnest(%s::bigint[], %s::text[], %s::text[], %s::text[])
    AS new (task_id, state, robot, record)
    ON CONFLICT (task_id) DO UPDATE
    SET revision = excluded.revision, state = excluded.state, robot = excluded.robot,
        record = excluded.record
"""
_FORGET_TASKS = "DELETE FROM taskrpc_task WHERE task_id = ANY(%s)"
_ARCHIVE_TASKS = """
    WITH gone AS (DELETE FROM taskrpc_task WHERE task_id = ANY(%s) RETURNING task_id, record)
    INSERT INTO taskrpc_history (number, task_id, ended_at, record)
    SELECT (SELECT coalesce(max(number), 0) FROM taskrpc_history)
        + row_number() OVER (ORDER BY ended_at, task_id), task_id, ended_at, record
    FROM gone JOIN unnest(%s::bigint[], %s::float8[]) AS ends (task_id, ended_at) USING (task_id)
"""
_PRUNE = (
    f"""
    DELETE FROM taskrpc_history WHERE number IN (
        SELECT number FROM taskrpc_history
        WHERE number <= (SELECT max(number) FROM taskrpc_history) - %s::bigint
        ORDER BY number LIMIT {AT_ONCE}
    )
    """,
    f"""
    DELETE FROM taskrpc_history WHERE number IN (
        SELECT number FROM taskrpc_history WHERE ended_at < %s::float8
        ORDER BY ended_at, task_id LIMIT {AT_ONCE}
    )
    """,
)
_SAVE_ROBOTS = """
    INSERT INTO taskrpc_robot (name, revision, lease_until, record)
    SELECT name, %s, to_timestamp(lease_until), record
    FROM unnest(%s::text[], %s::float8[], %s::text[]) AS new (name, lease_until, record)
    ON CONFLICT (name) DO UPDATE
    SET revision = excluded.revision, lease_until = excluded.lease_until,
        record = excluded.record
"""
_FORGET_CLIENTS = """
    DELETE FROM taskrpc_completion WHERE (principal, client) IN (
        SELECT entry->>0, entry->>1 FROM json_array_elements(%s::json) AS entry
    )
"""
_SAVE_COMPLETIONS = """
    INSERT INTO taskrpc_completion (principal, client, sequence, checksum, record)
    SELECT entry->>0, entry->>1, entry->>2, (entry->>3)::bigint, entry->>4
    FROM json_array_elements(%s::json) AS entry
    ON CONFLICT (principal, client, sequence) DO UPDATE
    SET checksum = excluded.checksum, record = excluded.record, stored_at = clock_timestamp()
"""
_SETTLE = """
    DELETE FROM taskrpc_completion AS found USING json_array_elements(%s::json) AS entry
    WHERE found.principal = entry->>0 AND found.client = entry->>1
    AND found.sequence COLLATE "C" < entry->>2
"""
_FORGET_OLD_CLIENTS = """
    DELETE FROM taskrpc_completion WHERE (principal, client) IN (
        SELECT principal, client FROM taskrpc_completion GROUP BY principal, client
        HAVING max(stored_at) < clock_timestamp() - make_interval(secs => %s)
    )
"""
_CLEAR = (
    "DELETE FROM taskrpc_task",
    "DELETE FROM taskrpc_history",
    "DELETE FROM taskrpc_completion",
    "UPDATE taskrpc_fleet SET store_id = uuid_send(gen_random_uuid())",
)
_SAVE_BATCH = """
    INSERT INTO taskrpc_writer (writer, batch) VALUES (%s, %s)
    ON CONFLICT (writer) DO UPDATE SET batch = excluded.batch, used_at = clock_timestamp()
"""
# It writes, so that a standby refuses it: there, a committed transaction may still be missing. And
# its commit waits for the standbys that the operator wants to have each commit.
_FIND_BATCH = """
    WITH found AS (
        UPDATE taskrpc_writer SET used_at = clock_timestamp() WHERE writer = %s RETURNING batch
    )
    SELECT (SELECT batch FROM found), extract(epoch FROM clock_timestamp())::float8
"""
_BATCHES_KEPT = 86_400.0  # seconds
_FORGET_BATCHES = """
    DELETE FROM taskrpc_writer
    WHERE writer = %s OR used_at < clock_timestamp() - make_interval(secs => %s)
"""
_END_OTHERS = """
    SELECT pg_terminate_backend(pid) FROM pg_stat_activity
    WHERE application_name = %s AND pid <> pg_backend_pid()
"""

_task_decoder = msgspec.json.Decoder(Task)
_robot_decoder = msgspec.json.Decoder(RobotRecord)
_meta_decoder = msgspec.json.Decoder(Meta)


class PostgresStore(FleetStore):
    """A server's access to the fleet's database in PostgreSQL.

    Args:
        url: `postgresql://USER:PASSWORD@HOST:PORT/DATABASE`; libpq's parameters and environment
            variables hold too, such as `?sslmode=verify-full` and PGPASSWORD.
        listen: whether to follow the changes of other servers.
        history: see `FleetStore`.

    Raises:
        TaskRpcError: the URL is not valid.
    """

    def __init__(self, url: str, *, listen: bool = True, history: History = DEFAULT) -> None:
        super().__init__(history=history)
        self.url = DatabaseUrl(url)
        self._listen = listen
        self._writer_name = f"taskrpc writer {os.urandom(8).hex()}"
        self._batch = 0
        """The number of this store's last attempt at a transaction; each attempt has its own."""
        self._connection: Connection | None = None
        self._reader: Connection | None = None
        self._reading = asyncio.Lock()
        self._is_prepared = False
        self._listening: asyncio.Task[None] | None = None
        self._store_id = b""
        self._known = -1
        """The revision up to which the copy has all rows; -1 before the first reading."""
        self._is_other_database = True
        """Whether a new connection may lead to another database, of which nothing is read yet."""
        self._clock: tuple[float, float] | None = None
        """The database's clock, and the loop's clock at the same time."""

    # Reading

    def _now(self) -> float:
        if self._clock is None:
            return time.time()
        database, loop = self._clock
        return database + asyncio.get_running_loop().time() - loop

    @property
    def _since(self) -> int:
        """The revision after which rows must be read; -1 for all rows.

        After a failover, a replica may lack the newest transactions and have others with the same
        revisions. So each new connection reads everything.
        """
        return -1 if self._is_other_database else self._known

    async def store_id(self) -> bytes:
        """Return the id that all servers of the database share. Raises StoreError."""
        if not self._store_id:
            await self.refresh()
        return self._store_id

    async def look_up(self, client: ClientKey) -> Sequence[Completion]:
        """Return the completions of a client. Raises StoreError."""
        principal, number = client
        return await self._completions(_OF_CLIENTS, [principal], [number.hex()])

    async def _all_completions(self) -> Sequence[Completion]:
        return await self._completions(_ALL_COMPLETIONS)

    async def forget_old_clients(self) -> None:
        """Forget the completions of clients whose lease has ended. Raises StoreError."""
        await self._read(_FORGET_OLD_CLIENTS, CLIENT_LEASE)

    async def _completions(self, query: str, *values: object) -> list[Completion]:
        return _completions_of(await self._read(query, *values) or [])

    async def _read(self, query: str, *values: object) -> list[tuple[Any, ...]] | None:
        """Return the rows of a statement outside the fleet's transactions. Raises StoreError."""
        async with self._reading:
            for is_last in (False, True):
                try:
                    if self._reader is None or self._reader.closed:
                        await self._prepared()
                        self._reader = await self.url.connect(self._writer_name + " reader")
                    return await answered(self._reader, _rows(self._reader, query, values))
                except FAILURES as error:
                    await close(self._reader)
                    self._reader = None
                    if is_last:
                        raise self.url.error("cannot be read", error) from error
        return None

    async def _follow(self) -> list[int] | None:
        for is_last in (False, True):  # the first attempt may find out that a connection is lost
            connection = await self._connected()
            try:
                return await answered(connection, self._read_changes(connection))
            except FAILURES as error:
                await self._disconnect()
                if is_last:
                    raise self.url.error("cannot be read", error) from error
        return None

    async def _read_changes(self, connection: Connection) -> list[int] | None:
        # One snapshot for all tables.
        async with connection.pipeline():
            await connection.execute("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY")
            fleet = await connection.execute(_LOOK)
            clock = await connection.execute(_CLOCK)
            tasks = await connection.execute(_TASKS, (self._since,))
            robots = await connection.execute(_ROBOTS, (self._since,))
            await connection.execute("COMMIT")
        before, is_other = self._known, self._is_other_database
        changed = await self._take_over(fleet, clock, tasks, robots)
        return changed if is_other or self._known != before else None

    async def _take_over(self, fleet: Any, clock: Any, tasks: Any, robots: Any) -> list[int]:
        """Bring the copy up to date with the rows of these cursors."""
        row = await fleet.fetchone()
        if row is None:
            raise StoreError("the table taskrpc_fleet is empty: expected one row; restore it")
        version, store_id, revision, record = row
        check_version(version)
        loop = asyncio.get_running_loop().time()
        self._clock = (await clock.fetchone())[0], loop
        if self._store_id not in (b"", store_id) or revision < self._since:
            # Another server has cleared the tasks, or an older backup was restored.
            self.state.forget_all()
            self._store_id, self._known = store_id, -1
            raise StoreError("the tasks of the fleet were replaced; they are read again")
        try:
            new_tasks = [_task_decoder.decode(each) for (each,) in await tasks.fetchall()]
            new_robots = [_robot_decoder.decode(each) for (each,) in await robots.fetchall()]
            meta = msgspec.structs.replace(_meta_decoder.decode(record), revision=revision)
        except msgspec.DecodeError as error:
            raise StoreError(
                f"a record of the fleet that was stored after revision {self._known} cannot be"
                f" read: {error}; restore a backup"
            ) from None
        # Only now: without these rows, the copy must not count as up to date.
        before = list(self.state.tasks) if self._is_other_database else []
        if self._is_other_database:
            self.state.forget_all()
        self._store_id, self._known, self._is_other_database = store_id, revision, False
        return list(dict.fromkeys([*before, *self.state.replace(meta, new_tasks, new_robots)]))

    # Transactions

    async def _commit(self, batch: Sequence[Pending[Any]]) -> tuple[list[Outcome], list[int]]:
        loop = asyncio.get_running_loop()
        deadline = loop.time() + PATIENCE
        while True:
            try:
                connection = await self._connected()
                try:
                    return await answered(connection, self._transaction(connection, batch))
                except _Uncertain as uncertain:
                    if await self._took_effect(uncertain, deadline + PATIENCE):
                        return uncertain.outcomes, self._committed(uncertain.changed)
                    problem: Exception = uncertain
                    self.state.undo()
            except (*FAILURES, StoreError) as error:
                # Nothing was committed: the error came before, or PostgreSQL has reported it.
                self.state.undo()
                problem = error
                connection_lost = self._connection is None or is_lost(self._connection, error)
                await self._disconnect()
                if not connection_lost:
                    raise self._error(problem) from problem
            except BaseException:
                # The next transaction and the next look connect again, and read everything.
                self.state.undo()
                await self._disconnect()
                raise
            if loop.time() >= deadline:
                raise self._error(problem) from problem
            await asyncio.sleep(_RETRY_AFTER)

    def _committed(self, changed: Sequence[int]) -> list[int]:
        """Keep the changes of a transaction in the copy; return all changed tasks."""
        self._known = self.state.meta.revision
        changes = self.state.take_changes()
        if changes.cleared:
            self._store_id = b""
        return [*changed, *changes.tasks]

    async def _transaction(
        self, connection: Connection, batch: Sequence[Pending[Any]]
    ) -> tuple[list[Outcome], list[int]]:
        requests = [pending.request for pending in batch if pending.request is not None]
        async with connection.pipeline():
            # The statements after the lock see everything that earlier holders have committed.
            await connection.execute("BEGIN ISOLATION LEVEL READ COMMITTED")
            fleet = await connection.execute(_LOCK)
            clock = await connection.execute(_CLOCK)
            tasks = await connection.execute(_TASKS, (self._since,))
            robots = await connection.execute(_ROBOTS, (self._since,))
            found = await connection.execute(_COMPLETED, _columns(requests)) if requests else None
        changed = await self._take_over(fleet, clock, tasks, robots)
        completed = {}
        if found is not None:
            for each in _completions_of(await found.fetchall()):
                completed[each.principal, each.client, each.sequence] = each
        outcomes = carry_out(self.state, self._now(), batch, completed)
        changes = self.state.changes
        if changes.is_empty:
            await connection.execute("ROLLBACK")
            self.state.take_changes()
            return outcomes, changed
        self._batch += 1
        number, begun = self._batch, self._now()
        try:
            await self._write_changes(connection, changes, number)
        except FAILURES as error:
            if is_lost(connection, error):
                raise _Uncertain(number, begun, outcomes, changed, error) from error
            raise
        return outcomes, self._committed(changed)

    async def _write_changes(self, connection: Connection, changes: Changes, number: int) -> None:
        meta = self.state.meta
        async with connection.pipeline():
            if changes.cleared:
                for statement in _CLEAR:
                    await connection.execute(statement)
            saved = [task for task in changes.tasks.values() if task is not None]
            if gone := [number for number, task in changes.tasks.items() if task is None]:
                if self.history.archived == 0:
                    await connection.execute(_FORGET_TASKS, (gone,))
                else:  # the statement must not read a record: JSON may contain what SQL cannot
                    ends = list(changes.ends), list(changes.ends.values())
                    await connection.execute(_ARCHIVE_TASKS, (gone, *ends))
            if saved:
                columns = (
                    [task.task_id for task in saved],
                    [task.state.value for task in saved],
                    [task.robot for task in saved],
                    [_text(task) for task in saved],
                )
                await connection.execute(_SAVE_TASKS, (meta.revision, *columns))
            if (now := changes.newest_end()) is not None:
                limits = self.history.archived, self.history.kept_since(now)
                for statement, limit in zip(_PRUNE, limits, strict=True):
                    if limit is not None:
                        await connection.execute(statement, (limit,))
            if robots := list(changes.robots.values()):
                names, leases = (
                    [each.name for each in robots],
                    [each.lease_until for each in robots],
                )
                values = meta.revision, names, leases, [_text(each) for each in robots]
                await connection.execute(_SAVE_ROBOTS, values)
            await self._write_completions(connection, changes)
            await connection.execute(_SAVE_META, (meta.revision, _text(meta)))
            await connection.execute(_SAVE_BATCH, (self._writer_name, number))
            if changes.notifies:
                await self._notify(connection, meta.revision)
            await connection.execute("COMMIT")

    async def _write_completions(self, connection: Connection, changes: Changes) -> None:
        if not changes.completions:
            return
        collected = CompletionBatch()
        for completion, clients in changes.completions:
            collected.add(completion, clients)
        statements = _FORGET_CLIENTS, _SAVE_COMPLETIONS, _SETTLE
        for statement, rows in zip(statements, collected.rows(), strict=True):
            if rows != "[]":
                await connection.execute(statement, (rows,))

    async def _notify(self, connection: Connection, revision: int) -> None:
        payload = f"{revision} {self._writer_name}"
        await connection.execute("SELECT pg_notify(%s, %s)", (_CHANNEL, payload))

    async def _took_effect(self, uncertain: _Uncertain, deadline: float) -> bool:
        """Return whether a transaction was committed whose connection was lost meanwhile.

        Raises OutcomeUnknown if that cannot be found out in time.
        """
        loop = asyncio.get_running_loop()
        while True:
            await self._disconnect()
            try:
                connection = await self._connected()
                return await answered(connection, self._is_stored(connection, uncertain))
            except (*FAILURES, StoreError) as error:
                if loop.time() >= deadline:
                    problem = f"{self.url}: the connection was lost during a commit"
                    reason = self.url.without_password(str(error))
                    raise OutcomeUnknown(f"{problem}, and then: {reason}") from error
            await asyncio.sleep(_RETRY_AFTER)

    async def _is_stored(self, connection: Connection, uncertain: _Uncertain) -> bool:
        # The process in PostgreSQL that served the lost connection may still be at work.
        for _ in range(_ENDING_LOOKS):
            if not await _rows(connection, _END_OTHERS, (self._writer_name,)):
                break
            await asyncio.sleep(0.01)
        else:
            raise StoreError(f"{self.url}: the lost connection does not end")
        ((number, now),) = await _rows(connection, _FIND_BATCH, (self._writer_name,))
        if number is None and now - uncertain.begun > _BATCHES_KEPT / 2:
            # As after a pause of this process: another server may have forgotten the number.
            raise OutcomeUnknown(
                f"{self.url}: the connection was lost during a commit, and the check came too late"
            )
        return bool(number == uncertain.number)

    def _error(self, error: BaseException) -> TaskRpcError:
        if isinstance(error, StoreError):
            return error
        return self.url.error("did not store anything", error)

    # Connections

    async def _prepared(self) -> None:
        """Create or upgrade the tables, once. Raises StoreError."""
        if self._is_prepared:
            return
        await check_pooling(self.url)
        connection = await self.url.connect("taskrpc schema")
        try:
            await answered(connection, prepare(connection))
        except FAILURES as error:
            raise self.url.error("cannot be prepared", error) from error
        finally:
            await close(connection)
        self._is_prepared = True

    async def _connected(self) -> Connection:
        """Return the connection for transactions. Raises StoreError."""
        if self._connection is None or self._connection.closed:
            await self._prepared()
            self._connection = await self.url.connect(self._writer_name)
            self._is_other_database = True
            if self._listen and self._listening is None:
                self._listening = asyncio.create_task(self._listen_for_ever())
        return self._connection

    async def _disconnect(self) -> None:
        connection, self._connection = self._connection, None
        await close(connection)

    async def close(self) -> None:
        """Wait for the running transactions, then disconnect; a later call connects again."""
        await self._idle()
        listening, self._listening = self._listening, None
        if listening is not None:
            listening.cancel()
            await asyncio.wait({listening})
        await self._idle()
        if self._connection is not None:
            with contextlib.suppress(*FAILURES):
                values = self._writer_name, _BATCHES_KEPT
                await answered(self._connection, _rows(self._connection, _FORGET_BATCHES, values))
        await self._disconnect()
        reader, self._reader = self._reader, None
        await close(reader)

    async def _listen_for_ever(self) -> None:
        """Look for changes at each notification, and at least every `POLL` seconds."""
        connection: Connection | None = None
        try:
            while True:
                try:
                    if connection is None or connection.closed:
                        connection = await self.url.connect(self._writer_name + " listener")
                        await connection.execute(f"LISTEN {_CHANNEL}")
                        self.notified()
                    await self._hear(connection)
                except (*FAILURES, StoreError) as error:
                    log.debug("notifications of the fleet: %s", error)
                    await close(connection)
                    connection = None
                    await asyncio.sleep(POLL)
                self._poll()
        finally:
            await close(connection)

    async def _hear(self, connection: Connection) -> None:
        """Pass on notifications for `POLL` seconds."""
        async for notice in connection.notifies(timeout=POLL):
            if not notice.payload.endswith(self._writer_name):
                self.notified()

    def _poll(self) -> None:
        self.notified()


class _Uncertain(Exception):
    """The connection was lost while a transaction was being written and committed."""

    def __init__(
        self,
        number: int,
        begun: float,
        outcomes: list[Outcome],
        changed: list[int],
        error: Exception,
    ) -> None:
        self.number = number
        self.begun = begun  # on the database's clock
        self.outcomes = outcomes
        self.changed = changed
        super().__init__(str(error))


async def _rows(
    connection: Connection, query: Any, values: Sequence[object] = ()
) -> list[tuple[Any, ...]]:
    cursor = await connection.execute(query, values)
    return await cursor.fetchall() if cursor.description else []


def _columns(requests: Sequence[RequestKey]) -> tuple[list[str], list[str], list[str]]:
    return (
        [principal for principal, _, _ in requests],
        [client.hex() for _, client, _ in requests],
        [f"{sequence:016x}" for _, _, sequence in requests],
    )


def _completions_of(rows: Sequence[tuple[Any, ...]]) -> list[Completion]:
    encoded = [(client, number, record.encode(), sum_) for client, number, record, sum_ in rows]
    try:
        return read_records(encoded, Completion, "taskrpc_completion", "client", "sequence")
    except Damaged as damaged:
        where = f" WHERE {damaged.where}" if damaged.where else ""
        raise StoreError(f"{damaged}{where}: restore a backup, or delete this row") from None


def _text(record: msgspec.Struct) -> str:
    return msgspec.json.encode(record).decode()
