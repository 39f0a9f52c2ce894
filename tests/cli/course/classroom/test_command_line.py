"""The output and the errors of `taskrpc classroom`, `join` and `leave`."""

from __future__ import annotations

import json
import sys
import time

import pytest

from taskrpc.cli.course.classroom import command_line
from taskrpc.cli.main import main
from taskrpc.core.security import lab
from taskrpc.course.classroom import own_addresses
from taskrpc.course.classroom.attendance import Attendance
from taskrpc.course.classroom.invitation import from_join_string


@pytest.fixture
def say(capsys):
    """Runs a command; returns what it printed, to stderr where its exit code is not 0."""

    def _say(*argv, code=0):
        assert main([*argv]) == code
        said = capsys.readouterr()
        return said.err if code else said.out

    return _say


@pytest.fixture
def make(say):
    def _make(*argv):
        return say("classroom", "--address", "192.0.2.7", *argv).splitlines()

    return _make


def test_class_without_students_has_one_join_string(make):
    (line,) = make()
    found = from_join_string(line)
    assert found.addresses == ("192.0.2.7:7450",)
    assert found.token.startswith("class.")
    assert found.expires - time.time() == pytest.approx(180 * 86_400, abs=60)


def test_second_run_prints_the_same_join_strings(make):
    assert make("--students", "2") == make()


def test_file_of_students_gives_each_name_a_join_string(make, tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("ada\n\n  grace \n", encoding="utf-8")
    found = dict(line.split() for line in make("--students", str(names), "--port", "7451"))
    assert list(found) == ["ada", "grace"]
    assert from_join_string(found["grace"]).namespace == "/grace"
    assert from_join_string(found["grace"]).addresses == ("192.0.2.7:7451",)


def test_names_in_any_script_are_shown_as_written(make, say, tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("José\nمحمد علي\nada\n", encoding="utf-8")
    found = dict(line.rsplit(maxsplit=1) for line in make("--students", str(names)))
    assert list(found) == ["José", "محمد علي", "ada"]
    assert from_join_string(found["José"]).namespace == "/Jose"
    assert from_join_string(found["محمد علي"]).token.startswith("student1.")
    shown = [line.split("  ")[0] for line in say("classroom", "roster").splitlines()]
    assert shown[:4] == ["NAME", "José (Jose)", "محمد علي (student1)", "ada"]
    rows = json.loads(say("classroom", "roster", "--json"))
    assert [(row["name"], row["account"]) for row in rows][1:] == [
        ("محمد علي", "student1"),
        ("ada", "ada"),
    ]
    assert say("classroom", "revoke", "محمد علي") == "محمد علي is revoked\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"ada\n\ngrace\nada\n", "names.txt, line 4: 'ada' appears twice"),
        (b"ada\nada;5;x\n", "names.txt, line 2: a student's name: expected 1 to 100 letters"),
        ("José\nJose\u0301\n".encode(), "names.txt, line 2: 'José' appears twice"),
        (b"\n \n", "names.txt: expected one name per line, got an empty file"),
        (b"\xff\xfe\x00", "names.txt: expected UTF-8 text"),
    ],
)
def test_invalid_name_is_reported_with_its_line_and_adds_no_account(say, tmp_path, text, message):
    names = tmp_path / "names.txt"
    names.write_bytes(text)
    where = "--address", "192.0.2.7", "--students", str(names)
    assert message in say("classroom", *where, code=1)
    assert command_line._register().accounts() == []


def test_existing_join_strings_are_not_shown_when_the_server_starts(make, monkeypatch, capsys):
    served = []
    monkeypatch.setattr(
        "taskrpc.cli.robot.server.command_line.main", lambda argv: served.append(argv) or 0
    )
    assert make("--serve", "--speed", "2") != [], "the one of all is for the projector"
    made = make("--students", "2")
    assert make("--serve") == []
    assert len(make("--students", "2", "--serve")) == len(made) == 2
    assert [argv[-2:] == ["--speed", "2"] for argv in served] == [True, False, False]


def test_a_class_keeps_its_port_until_another_is_given(make, monkeypatch):
    served = []
    monkeypatch.setattr(
        "taskrpc.cli.robot.server.command_line.main", lambda argv: served.append(argv) or 0
    )
    options = (), ("--port", "7461"), (), ("--port", "7462")
    places = [from_join_string(make(*argv)[0]).addresses[0] for argv in options]
    assert places == [f"192.0.2.7:{port}" for port in (7450, 7461, 7461, 7462)]
    make("--serve")
    assert "0.0.0.0:7462" in served[-1]


def test_the_certificate_stays_until_it_is_renewed(make):
    first, again, renewed = (
        from_join_string(make(*argv)[0]).fingerprint for argv in ((), (), ("--renew",))
    )
    assert first == again != renewed


def test_students_are_added_and_revoked_later(make, say):
    make("--students", "2")
    assert from_join_string(say("classroom", "add", "eve")).token.startswith("eve.")
    assert say("classroom", "revoke", "student1") == "student1 is revoked\n"
    assert [line.split()[0] for line in make()] == ["student2", "eve"]
    assert "there is no account 'bob'" in say("classroom", "revoke", "bob", code=1)


def test_the_addresses_of_this_machine_are_found(say, monkeypatch):
    monkeypatch.setattr(own_addresses, "_outgoing", lambda: ["10.1.2.3", "127.0.0.1"])
    monkeypatch.setattr(
        own_addresses, "_of_host_name", lambda: ["127.0.1.1", "10.1.2.3", "192.168.5.6"]
    )
    found = from_join_string(say("classroom"))
    assert found.addresses == ("10.1.2.3:7450", "192.168.5.6:7450")


def test_machine_without_a_network_is_reported(say, monkeypatch):
    monkeypatch.setattr(own_addresses, "_outgoing", list)
    monkeypatch.setattr(own_addresses, "_of_host_name", lambda: ["127.0.1.1"])
    said = say("classroom", code=1)
    assert "no address in a network" in said
    assert "--address HOST" in said


@pytest.mark.parametrize(
    ("argv", "code", "message"),
    [
        (("--students", "none.txt"), 1, "--students none.txt: No such file or directory"),
        (("--students", "0"), 1, "--students: expected a number from 1 to 1000, got 0"),
        (("--students", "1001"), 1, "--students: expected a number from 1 to 1000, got 1001"),
        (("--students", "9" * 5000), 1, "--students: expected a number from 1 to 1000, got 99"),
        (
            ("--address", "10.0.0.1:7450"),
            2,
            "expected a host name or an address, got '10.0.0.1:7450'",
        ),
        (("--port", "70000"), 2, "expected a port from 1 to 65535, got '70000'"),
        (("--days", "0"), 2, "expected a whole number from 1 to 36500, got '0'"),
        (("--days", "9" * 5000), 2, "expected a whole number from 1 to 36500, got '999"),
        (("add", "--days", "1000000", "ada"), 2, "expected a whole number from 1 to 36500"),
        (("add", "ada"), 1, "there is no class yet: `taskrpc classroom` makes one"),
    ],
)
def test_mistake_prints_one_sentence(say, argv, code, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert message in say("classroom", "--address", "192.0.2.7", *argv, code=code)


def test_missing_cryptography_prints_the_pip_command(say, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    said = say("classroom", "--address", "192.0.2.7", code=1)
    assert said.splitlines()[-1] == (
        "making certificates needs the library cryptography: pip install cryptography"
    )


@pytest.mark.real_time
def test_roster_shows_last_calls_and_revoked_students(make, say):
    make("--students", "3")
    register = command_line._register()
    attendance = Attendance(register.attendance_file, lambda: 1_700_000_000.0)
    attendance._seen["student2"] = 1_700_000_000.0
    attendance.node_ended(None)
    register.revoke("student3")
    rows = json.loads(say("classroom", "roster", "--json"))
    assert [row["state"] for row in rows] == ["invited", "joined", "revoked"]
    assert [row["last_call"] for row in rows] == [None, 1_700_000_000.0, None]
    assert [row["waiting"] for row in rows] == [None, None, None]
    shown = say("classroom", "roster")
    assert shown.splitlines()[2].split()[:3] == ["student2", "joined", "2023-11-14"]
    assert "the task server is not running" in shown


def test_join_expects_a_string_or_one_option(say):
    assert "expected a join string, --status or --leave" in say("join", code=2)
    assert "expected a join string, --status or --leave" in say("join", "x", "--status", code=2)
    assert "expected a join string, which begins with" in say("join", "x", code=1)


def test_leaving_forgets_the_lab(say):
    assert say("join", "--leave", code=1) == "you have not joined a lab\n"
    lab.remember_lab(lab.Lab(address="192.0.2.7:1", token="ada.x", certificate="x"))
    assert "You have left the lab" in say("join", "--leave")
    assert lab.remembered_lab() is None
