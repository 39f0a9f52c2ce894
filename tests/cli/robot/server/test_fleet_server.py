"""`taskrpc-server --db postgresql://…`: its options, and mistakes in them."""

import logging
import sys
from argparse import Namespace

import pytest

from taskrpc.cli.robot.server import fleet_server
from taskrpc.cli.robot.server.command_line import main
from taskrpc.core.security.installing import install_command
from taskrpc.robot.tasks import History

URL = "postgresql://ann:s3cret-word@127.0.0.1:1/fleet"


@pytest.fixture
def server(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def _server(*argv):
        code, out, err = run(*argv, command=main)
        assert out == ""
        assert "s3cret" not in err
        assert "Traceback" not in err
        return code, err.splitlines()[-1]

    return _server


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--robot-name", "r1"], "--robot-name is for a fleet; it needs --db postgresql://…"),
        (["--capabilities", "move"], "--capabilities is for a fleet; it needs --db postgresql://…"),
        (
            ["--db", "mysql://x/y"],
            "--db: expected a file, :memory: or postgresql://…, got mysql:…",
        ),
        (
            ["--db", "POSTGRESQL://ann:s3cret@x/y", "--robot-name", "r1"],
            "--db: expected a file, :memory: or postgresql://…, got POSTGRESQL:…",
        ),
        (
            ["--db", "postgresql:/ann:s3cret@x/y"],
            "--db: expected a file, :memory: or postgresql://…, got postgresql:…",
        ),
        (["--db", "postgres//ann:s3cret@x/y"], "got postgres/…"),
        (["--db", "postgresql+psycopg://ann:s3cret@x/y"], "got postgresql+psycopg:…"),
        (["--db", URL, "--join"], "--join is for single servers"),
        (["--db", URL, "--robot-name", "x" * 64], "expected up to 63 letters, digits"),
        (["--db", URL, "--capabilities", " "], "--capabilities: expected a list such as"),
        (["--db", URL, "--standby"], "--standby waits for another server of one database file;"),
        (["--db", URL, "--record", "x.mcap"], "--record records one robot's queue;"),
        (["--db", URL, "--robot-name", "1 a"], "--robot-name: expected up to 63 letters, digits"),
        (["--db", URL, "--capabilities", "move,"], "--capabilities: expected a list such as"),
    ],
)
def test_options_that_do_not_fit_are_refused(server, options, problem):
    code, error = server(*options)
    assert code == 2
    assert problem in error


def test_wrong_url_is_explained(server):
    pytest.importorskip("psycopg")
    code, error = server("--db", f"{URL}?unknown=1")
    assert code == 1
    assert "expected a URL such as postgresql://USER:PASSWORD@HOST:5432/DATABASE" in error


@pytest.mark.real_time
def test_missing_postgres_is_named(server):
    pytest.importorskip("psycopg")
    code, error = server("--db", URL)
    assert code == 1
    assert "postgresql://ann@127.0.0.1:1/fleet cannot be used: " in error
    assert "start PostgreSQL there" in error


def test_missing_psycopg_is_named_with_the_command(server, monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    for name in [each for each in sys.modules if each.startswith("taskrpc.robot.fleet.postgres")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("taskrpc.robot.fleet.postgres.connection", raising=False)
    code, error = server("--db", URL)
    assert code == 1
    assert install_command("postgres", "psycopg[binary]") in error


def test_password_in_the_command_is_reported(caplog):
    pytest.importorskip("psycopg")
    for url, count in ((URL, 1), (URL.replace(":s3cret-word", ""), 0)):
        caplog.clear()
        fleet_server.store_of(Namespace(db=url), History())
        assert caplog.text.count("put it into PGPASSWORD or ~/.pgpass instead") == count
        assert "s3cret" not in caplog.text


def test_warnings_of_psycopg_are_left_out(caplog):
    pytest.importorskip("psycopg")
    fleet_server.store_of(Namespace(db="postgresql://ann@127.0.0.1:1/fleet"), History())
    logging.getLogger("psycopg").warning("error ignored terminating a pipeline")
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("machine", "name"),
    [("lab-3.local", "lab_3_local"), ("7of9", "robot_7of9"), ("", "robot"), ("x" * 80, None)],
)
def test_robot_has_the_name_of_its_machine(monkeypatch, machine, name):
    monkeypatch.setattr("platform.node", lambda: machine)
    found = fleet_server.default_name()
    assert fleet_server._NAME.fullmatch(found)
    assert name in (None, found)
