"""The ready-made stores: effect and completion together, and what a user may get wrong."""

import asyncio
import contextlib
import re
import sqlite3
from functools import partial

import pytest

from taskrpc import MemoryCompletions, SqliteCompletions
from taskrpc.core.request_ids.ids import Completion, CompletionStore
from taskrpc.errors import StoreError, text_for_callers

TABLE = "CREATE TABLE IF NOT EXISTS stock (part TEXT PRIMARY KEY, count INTEGER CHECK (count >= 0))"

FILLED = "INSERT OR IGNORE INTO stock VALUES ('nut', 0)"


def completion(sequence, first=1, client=b"c" * 16):
    return Completion("ann", client, sequence, first, b"f" * 16, b"\x00\xff", 0, 1.0)


class Memory:
    """Counts in a variable."""

    def __init__(self, tmp_path):
        self.store = MemoryCompletions()
        self.count = 0

    def effect(self, more):
        def add():
            if self.count + more < 0:
                raise ValueError("there are not so many")
            self.count += more

        return add

    async def close(self):
        pass


class Sqlite:
    """Counts in a table."""

    def __init__(self, tmp_path):
        self.path = tmp_path / "stock.db"
        self.store = SqliteCompletions(self.path, [TABLE, FILLED])

    def effect(self, more):
        return [("UPDATE stock SET count = count + :more", {"more": more})]

    @property
    def count(self):
        with contextlib.closing(sqlite3.connect(self.path)) as connection:
            return connection.execute("SELECT count FROM stock").fetchone()[0]

    async def close(self):
        await self.store.close()


class Tables(Sqlite):
    """Counts in a table in memory."""

    def __init__(self, make):
        self.store = make(schema=[TABLE, FILLED])


@pytest.fixture(params=[Memory, Sqlite])
async def stock(request, tmp_path):
    stock = request.param(tmp_path)
    await stock.store.recall()
    yield stock
    await stock.close()


@pytest.fixture(params=["MemoryCompletions", "memory", "file"])
async def tables(request, tmp_path):
    """Every store that takes SQL."""
    kinds = {
        "MemoryCompletions": MemoryCompletions,
        "memory": partial(SqliteCompletions, ":memory:"),
        "file": partial(SqliteCompletions, tmp_path / "stock.db"),
    }
    stock = Tables(kinds[request.param])
    await stock.store.recall()
    yield stock
    await stock.close()


COUNT = "SELECT part, count FROM stock"


async def test_every_ready_made_store_takes_sql_effects(tables):
    await complete(tables.store, completion(1), tables.effect(5))
    await complete(tables.store, completion(2), None)
    assert await tables.store.query(COUNT) == [("nut", 5)]
    assert await known(tables.store) == [(b"c", 1), (b"c", 2)]


async def test_a_failed_sql_effect_changes_nothing_in_any_store(tables):
    both = [*tables.effect(3), *tables.effect(-9)]
    with pytest.raises(StoreError, match="CHECK constraint failed"):
        await complete(tables.store, completion(1), both)
    assert await tables.store.query(COUNT) == [("nut", 0)]
    assert await known(tables.store) == []


@pytest.mark.parametrize("sql", ["COMMIT", "-- done\nROLLBACK", "PRAGMA query_only = OFF"])
async def test_no_store_lets_an_effect_end_the_transaction(tables, sql):
    with pytest.raises(StoreError, match="an effect is part of a transaction: it cannot do"):
        await complete(tables.store, completion(1), [*tables.effect(1), (sql, ())])
    assert await tables.store.query(COUNT) == [("nut", 0)]


@pytest.mark.parametrize("sql", ["DELETE FROM stock", "COMMIT", "SELECT * FROM stocks"])
async def test_a_query_changes_nothing(tables, sql):
    with pytest.raises(StoreError, match=r"readonly|not authorized|no such table"):
        await tables.store.query(sql)
    await complete(tables.store, completion(1), tables.effect(2))
    assert await tables.store.query(COUNT + " WHERE part = ?", ["nut"]) == [("nut", 2)]


async def test_the_path_memory_makes_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    store = SqliteCompletions(":memory:")
    await store.complete(completion(1))
    assert list(tmp_path.iterdir()) == []
    await store.close()
    assert await known(store) == []
    await store.close()


async def test_schema_with_a_mistake_is_refused_in_memory_too():
    store = SqliteCompletions(":memory:", ["CREATE TABEL stock (part)"])
    with pytest.raises(StoreError, match=r"own tables cannot be created: .*syntax error"):
        await store.recall()
    await store.close()


@pytest.mark.parametrize(
    "effect", [[("DELETE FROM secrets", ())], [("COMMIT -- secrets", ())], "DELETE FROM secrets"]
)
async def test_sql_text_is_not_for_callers(tables, effect):
    with pytest.raises(StoreError, match="secrets") as caught:
        await complete(tables.store, completion(1), effect)
    assert text_for_callers(caught.value) == "nothing was stored; the server's log says why"


@pytest.mark.parametrize("kind", ["MemoryCompletions", "memory", "file"])
async def test_sql_text_of_a_schema_is_not_for_callers(tmp_path, kind):
    schema = ["INSERT INTO secrets VALUES (1)"]
    if kind == "MemoryCompletions":
        opening = MemoryCompletions(schema).query("SELECT 1")
    else:
        path = ":memory:" if kind == "memory" else tmp_path / "stock.db"
        opening = SqliteCompletions(path, schema).recall()
    with pytest.raises(StoreError, match="be created: no such table: secrets") as caught:
        await opening
    assert text_for_callers(caught.value) == "nothing was stored; the server's log says why"


async def test_wrong_query_is_blamed_on_the_query(tables):
    with pytest.raises(StoreError, match="the query failed: no such table: stocks") as caught:
        await tables.store.query("SELECT * FROM stocks")
    assert "cannot be used" not in str(caught.value)


async def known(store):
    return sorted((each.client[:1], each.sequence) for each in (await store.recall()).completions)


async def complete(store: CompletionStore, *done):
    """Complete a request as a service does: a store may have done it at once."""
    storing = store.complete(*done)
    if storing is not None:
        await storing


async def test_an_effect_and_its_completion_are_remembered_together(stock):
    await complete(stock.store, completion(1), stock.effect(5), ())
    assert stock.count == 5
    assert (await stock.store.recall()).completions == (completion(1),)


async def test_an_effect_that_fails_leaves_nothing_behind(stock):
    await complete(stock.store, completion(1), stock.effect(1))
    with pytest.raises(StoreError, match=r"not so many|CHECK constraint failed"):
        await complete(stock.store, completion(2, first=2), stock.effect(-2), [("ann", b"c" * 16)])
    assert stock.count == 1
    assert await known(stock.store) == [(b"c", 1)]


async def test_a_request_without_effect_or_without_number_is_taken_too(stock):
    await complete(stock.store, completion(1), None, ())
    await complete(stock.store, None, stock.effect(2), ())
    assert (stock.count, await known(stock.store)) == (2, [(b"c", 1)])


async def test_settled_requests_and_lapsed_clients_are_forgotten(stock):
    for sequence in (1, 2, 3):
        await complete(stock.store, completion(sequence), None)
        await complete(stock.store, completion(sequence, client=b"d" * 16), None)
    await complete(stock.store, completion(4, first=3), None, [("ann", b"d" * 16)])
    assert await known(stock.store) == [(b"c", 3), (b"c", 4)]


async def test_a_store_keeps_its_id(stock):
    first = (await stock.store.recall()).store_id
    assert (len(first), (await stock.store.recall()).store_id) == (16, first)


async def test_a_file_remembers_after_it_was_closed(tmp_path):
    stock = Sqlite(tmp_path)
    await complete(stock.store, completion(1), stock.effect(3))
    before = await stock.store.recall()
    await stock.close()
    assert stock.count == 3
    again = Sqlite(tmp_path)
    assert await again.store.recall() == before
    assert again.count == 3
    await again.close()


@pytest.mark.parametrize(
    "sql",
    [
        *("COMMIT", " rollback", "\nBegin immediate", "PRAGMA synchronous = OFF", "VACUUM"),
        *("-- done\nCOMMIT", "/* a */ END", "; COMMIT", "\ufeffROLLBACK", "--\nSAVEPOINT a"),
        *("-- a\nATTACH 'other.db' AS other", "--\nPRAGMA journal_mode = OFF"),
    ],
)
async def test_an_effect_cannot_end_the_transaction_of_which_it_is_part(tmp_path, sql):
    stock = Sqlite(tmp_path)
    with pytest.raises(StoreError, match="an effect is part of a transaction: it cannot do"):
        await complete(stock.store, completion(1), [*stock.effect(1), (sql, ())])
    assert await known(stock.store) == []
    assert stock.count == 0
    await stock.close()


async def test_an_effect_that_would_end_the_transaction_harms_no_others(tmp_path):
    stock = Sqlite(tmp_path)
    bad = [*stock.effect(100), ("-- done\nCOMMIT", ())]
    outcomes = await asyncio.gather(
        *(
            complete(stock.store, completion(1, client=bytes([n] * 16)), stock.effect(1))
            for n in (1, 2)
        ),
        complete(stock.store, completion(1, client=b"b" * 16), bad),
        complete(stock.store, completion(1, client=b"3" * 16), stock.effect(1)),
        return_exceptions=True,
    )
    assert [type(outcome) for outcome in outcomes] == [
        type(None),
        type(None),
        StoreError,
        type(None),
    ]
    assert stock.count == 3
    assert len(await known(stock.store)) == 3
    await stock.close()


@pytest.mark.parametrize("effect", ["DELETE FROM stock", ("DELETE FROM stock", ()), [("a",)], 3])
async def test_invalid_effect_is_refused_without_any_change(tmp_path, effect):
    stock = Sqlite(tmp_path)
    with pytest.raises(StoreError, match=r"expected an effect of pairs \[\(sql, parameters\)"):
        await stock.store.complete(completion(1), effect)
    assert await known(stock.store) == []
    await stock.close()


async def test_a_mistake_in_a_statement_is_one_sentence(tmp_path):
    stock = Sqlite(tmp_path)
    with pytest.raises(StoreError, match=r"^nothing was stored: no such table: stocks$"):
        await complete(stock.store, completion(1), [("DELETE FROM stocks", ())])
    await stock.close()


async def test_the_tables_of_a_program_may_be_there_already(tmp_path):
    path = tmp_path / "stock.db"
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute(TABLE)
        connection.execute("INSERT INTO stock VALUES ('nut', 7)")
        connection.commit()
    store = SqliteCompletions(path)
    await store.complete(completion(1), [("UPDATE stock SET count = 8", ())])
    await store.close()
    with contextlib.closing(sqlite3.connect(path)) as connection:
        assert connection.execute("SELECT * FROM stock").fetchall() == [("nut", 8)]


async def test_second_program_on_the_file_gets_the_name_of_the_first(tmp_path):
    stock = Sqlite(tmp_path)
    await stock.store.recall()
    with pytest.raises(StoreError, match=r"in use by another program \(pid \d+, since "):
        await SqliteCompletions(stock.path).recall()
    await stock.close()


async def test_invalid_schema_is_reported_and_creates_no_tables(tmp_path):
    path = tmp_path / "stock.db"
    with pytest.raises(StoreError, match=rf"{re.escape(str(path))}: .*syntax error"):
        await SqliteCompletions(path, ["CREATE TABEL stock (part)"]).recall()
    with contextlib.closing(sqlite3.connect(path)) as connection:
        assert connection.execute("SELECT * FROM sqlite_master").fetchall() == []


async def test_many_at_once_are_all_kept(stock):
    calls = (complete(stock.store, completion(each), stock.effect(1)) for each in range(1, 101))
    await asyncio.gather(*calls)
    assert (stock.count, len(await known(stock.store))) == (100, 100)
