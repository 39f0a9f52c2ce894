"""`taskrpc task export`: all ended tasks of a database, as CSV or as lines of JSON."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import sqlite3

import msgspec
import pytest

from taskrpc.cli.main import main
from taskrpc.cli.robot.task import export as export_module
from taskrpc.cli.robot.task.export import COLUMNS, export
from taskrpc.errors import StoreError
from taskrpc.robot.tasks import History, SqliteStore, Task, TaskManager, TaskSettings, TaskState
from taskrpc.robot.tasks.records import task_tables
from taskrpc.robot.tasks.records.archive import PAGE, SqliteEndedTasks
from tests.robot.tasks.fakes import LineRobot

NOW = 1_764_403_200.0  # 2025-11-29T08:00:00Z


def make(number, **changes):
    known = {"task_type": "move", "target": "1", "priority": 5, "arrival": number}
    known |= {"state": TaskState.SUCCEEDED, "submitted_at": NOW, "ended_at": NOW + number}
    return Task(task_id=number, **(known | changes))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "tasks.db"


async def store(path, *tasks):
    store = SqliteStore(path)
    await store.apply(tasks)
    await store.close()


async def exported(path, since=0.0, as_csv=True):
    text = io.StringIO()
    await export(str(path), since, as_csv=as_csv, write=text.write)
    return text.getvalue()


async def rows(path, since=0.0):
    return list(csv.DictReader(io.StringIO(await exported(path, since))))


async def test_row_says_who_submitted_decided_and_ended_a_task_when_and_why(path):
    task = make(
        7,
        target="dock",
        state=TaskState.CANCELED,
        started_at=NOW + 1.5,
        ended_at=NOW + 60.25,
        client="ann",
        machine="10.0.0.7",
        robot="robot_2",
        message="the robots were stopped by cem",
    )
    task = task.decided(NOW + 1, "ben", "moved to priority 5").decided(NOW + 60, "cem", "stopped")
    await store(path, task)
    assert await rows(path) == [
        {
            "task_id": "7",
            "task_type": "move",
            "target": "dock",
            "priority": "5",
            "state": "CANCELED",
            "submitted_by": "ann",
            "submitted_from": "10.0.0.7",
            "robot": "robot_2",
            "submitted": "2025-11-29T08:00:00.000Z",
            "started": "2025-11-29T08:00:01.500Z",
            "ended": "2025-11-29T08:01:00.250Z",
            "ended_by": "cem",
            "reason": "the robots were stopped by cem",
            "decisions": "2025-11-29T08:00:01.000Z ben: moved to priority 5;"
            " 2025-11-29T08:01:00.000Z cem: stopped",
        }
    ]
    [line] = (await exported(path, as_csv=False)).splitlines()
    found = json.loads(line)
    assert tuple(found) == COLUMNS
    assert (found["task_id"], found["started"]) == (7, "2025-11-29T08:00:01.500Z")
    assert found["decisions"][1] == {
        "at": "2025-11-29T08:01:00.000Z",
        "by": "cem",
        "action": "stopped",
    }


async def test_task_that_its_robot_ended_names_no_client_as_its_end(path):
    failed = make(1, state=TaskState.FAILED, message="the arm is stuck")
    await store(path, failed.decided(NOW, "ann", "queued again"))
    [row] = await rows(path)
    assert (row["ended_by"], row["reason"], row["started"]) == ("", "the arm is stuck", "")


async def test_export_has_only_ended_tasks_in_the_order_of_their_ends(path):
    waiting = make(1, state=TaskState.QUEUED, ended_at=None)
    interrupted = make(4, state=TaskState.INTERRUPTED, ended_at=NOW)
    await store(path, waiting, make(2, ended_at=NOW + 9), make(3), interrupted)
    assert [row["task_id"] for row in await rows(path)] == ["4", "3", "2"]
    assert [row["task_id"] for row in await rows(path, NOW + 3)] == ["3", "2"]


async def test_text_of_a_client_is_no_formula_of_a_spreadsheet(path):
    targets = ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", 'a "b", c', "two\nlines", "3,4"]
    await store(path, *(make(number, target=each) for number, each in enumerate(targets, 1)))
    found = [row["target"] for row in await rows(path)]
    assert found == ["'=1+1", "'+1", "'-1", "'@SUM(A1)", "'\t=1", *targets[5:]]
    lines = (await exported(path, as_csv=False)).splitlines()
    assert [json.loads(line)["target"] for line in lines] == targets


async def test_database_without_ended_tasks_gives_only_the_heading(path):
    await store(path)
    assert await exported(path) == ",".join(COLUMNS) + "\n"
    assert await exported(path, as_csv=False) == ""


async def test_server_works_while_an_export_waits_for_its_reader(path):
    store = SqliteStore(path, history=History(count=None, recent=1))
    settings = TaskSettings(wall_clock=lambda: NOW + asyncio.get_running_loop().time())
    manager = TaskManager(LineRobot(), store, settings)
    await manager.start()
    for _ in range(3):
        await manager.submit("scan", "0", 5)
    await asyncio.sleep(60)
    source = SqliteEndedTasks(path)
    recent = await source.recent()
    await manager.submit("scan", "0", 5)
    await asyncio.sleep(60)
    assert [task.task_id for task in await source.archived((0.0, -1))] == [1, 2, 3]
    assert [task.task_id for task in recent] == [3]
    await manager.close()
    assert [row["task_id"] for row in await rows(path)] == ["1", "2", "3", "4"]
    again = SqliteStore(path)
    assert (await again.load()).next_id == 5
    await again.close()


@pytest.mark.postgres
@pytest.mark.real_time
async def test_archived_and_recent_tasks_of_a_fleet_are_exported(postgres_url):
    pytest.importorskip("psycopg")
    from taskrpc.robot.fleet.postgres.store import PostgresStore

    store = PostgresStore(postgres_url, history=History(count=10, recent=2))
    for number in range(1, 6):
        await store.apply([make(number, robot="robot_2")])
    assert [row["task_id"] for row in await rows(postgres_url)] == list("12345")
    assert {row["robot"] for row in await rows(postgres_url, NOW + 4)} == {"robot_2"}
    await store.close()


class Counted:
    """Ended tasks that are read a page at a time; notes what was written before each page."""

    def __init__(self, source, written):
        self._source, self._written = source, written
        self.read = 0
        self.pages = []

    async def recent(self):
        return await self._source.recent()

    async def archived(self, after):
        assert self._written() == self.read, "a page is read before the last one is written"
        page = await self._source.archived(after)
        self.read += len(page)
        self.pages.append(len(page))
        return page

    async def close(self):
        await self._source.close()


async def test_export_of_100_000_tasks_keeps_only_one_page(path, monkeypatch):
    await store(path, make(100_001), make(100_002))
    record = msgspec.json.encode(make(1)).decode()
    rows = []
    for number in range(1, 100_001):
        own = record.replace('"task_id":1,', f'"task_id":{number},')
        own = own.replace(f'"ended_at":{NOW + 1}', f'"ended_at":{NOW + number}')
        rows.append((number, NOW + number, own, task_tables.with_checksum(own.encode(), number)[0]))
    with sqlite3.connect(path) as connection:
        statement = "INSERT INTO history (task_id, ended_at, record, checksum) VALUES (?, ?, ?, ?)"
        connection.executemany(statement, rows)
    connection.close()
    written = []  # task ids, not texts
    source = Counted(SqliteEndedTasks(path), lambda: len(written))
    monkeypatch.setattr(export_module, "_source", lambda database: source)

    def write(text):
        written.extend(json.loads(line)["task_id"] for line in text.splitlines())

    await export(None, 0.0, as_csv=False, write=write)
    assert written == list(range(1, 100_003))
    assert source.pages == [PAGE] * (100_000 // PAGE) + [0]


async def test_damaged_row_is_an_error_that_names_it(path):
    await store(path, make(3))
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE task SET checksum = 0")
    connection.close()
    with pytest.raises(StoreError, match="the checksum does not match, row task_id = 3"):
        await exported(path)


async def test_file_of_another_program_or_format_is_refused(path):
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE other (a)")
    connection.close()
    with pytest.raises(StoreError, match="expected a task database, found another program's"):
        await exported(path)
    path.unlink()
    await store(path)
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 2")
    connection.close()
    with pytest.raises(StoreError, match=r"found format 2; start the taskrpc-server of this"):
        await exported(path)


# The command


def test_missing_database_is_named_with_what_to_do(run, tmp_path):
    code, out, err = run("task", "export", "--db", str(tmp_path / "none.db"), command=main)
    assert (code, out) == (1, "")
    assert "expected the database of a task server, found no such file; start taskrpc-server" in err


@pytest.mark.parametrize(
    ("since", "expected"),
    [
        ("2025-11-29", ["1", "2", "3"]),
        ("2025-11-29T08:00:02Z", ["2", "3"]),
        ("2025-11-29T09:00:03+01:00", ["3"]),
        ("1m", ["1", "2", "3"]),
        ("2026-01-01", []),
    ],
)
def test_since_takes_an_instant_or_a_time_before_now(run, path, monkeypatch, since, expected):
    asyncio.run(store(path, *map(make, (1, 2, 3))))
    monkeypatch.setattr("taskrpc.spi.time_of_day", lambda: NOW + 5)
    code, out, _ = run("task", "export", "--db", str(path), "--since", since, command=main)
    assert code == 0
    assert [row["task_id"] for row in csv.DictReader(io.StringIO(out))] == expected


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--since", "yesterday"], "argument --since: expected a time such as 2026-11-29"),
        (["--csv", "--jsonl"], "not allowed with argument --csv"),
        (["--db", "mysql://ann:s3cret@x/y"], "expected a file, :memory: or postgresql://…, got my"),
    ],
)
def test_wrong_option_is_refused(run, options, problem):
    code, out, err = run("task", "export", *options, command=main)
    assert (code, out) == (2, "")
    assert problem in err
    assert "s3cret" not in err


def test_export_reads_the_database_of_a_server_without_options(run, monkeypatch, path):
    monkeypatch.setattr(export_module, "default_database", lambda: path)
    asyncio.run(store(path, make(1)))
    code, out, _ = run("task", "export", "--jsonl", command=main)
    assert code == 0
    assert json.loads(out)["task_id"] == 1
