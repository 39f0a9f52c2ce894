"""Every command ends with its documented exit code and at most one message."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

import srvgen
from taskrpc import errors
from taskrpc.cli.main import main
from taskrpc.cli.shared import command
from taskrpc.cli.shared.command import (
    Exit,
    NotFound,
    UsageError,
    exit_after,
    exit_code,
    guarded,
    hinted,
)

MODULES_OF_A_SERVER = 91
"""Modules of taskrpc and srvgen that a program with one service imports; each delays its start."""


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UsageError("x"), 2),
        (NotFound("x"), 1),
        (errors.DeadlineExceeded("x"), 3),
        (errors.DeadlineExceeded("x", not_executed=True), 4),
        (errors.ServiceUnavailable("x"), 4),
        (errors.ServerBusy("x"), 4),
        (errors.ConnectionLost("x", not_executed=True), 4),
        (errors.ConnectionLost("x"), 5),
        (errors.OutcomeUnknown("x"), 5),
        (errors.HandlerFailed(errors.Code.INTERNAL, "x"), 1),
        (errors.TypeMismatch("x"), 1),
        (errors.InvalidRequest("a", "x"), 1),
        (errors.InvalidName("x", 0), 1),
        (errors.AuthenticationFailed("x"), 1),
        (errors.ProtocolError("x"), 1),
        (srvgen.DefinitionError("x"), 1),
        (OSError("x"), 1),
    ],
)
def test_each_error_has_its_exit_code(error, code, capsys):
    def fail(argv):
        raise error

    assert exit_code(error) == code
    assert guarded(fail, []) == code
    assert "Traceback" not in capsys.readouterr().err


def test_defect_of_taskrpc_shows_its_traceback():
    def fail(argv):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        guarded(fail, [])


def test_ctrl_c_is_silent(capsys):
    def interrupt(argv):
        raise KeyboardInterrupt

    assert guarded(interrupt, []) == Exit.INTERRUPTED == 130
    assert capsys.readouterr() == ("", "")


def test_hints_follow_the_message_on_separate_lines(capsys):
    def fail(argv):
        raise hinted(hinted(NotFound("nothing there"), "look again"), "")

    guarded(fail, [])
    assert capsys.readouterr().err == "nothing there\n  hint: look again\n"
    guarded(fail, ["--json"])
    assert json.loads(capsys.readouterr().err) == {
        "error": "NotFound",
        "message": "nothing there",
        "hint": "look again",
    }


@pytest.mark.parametrize(
    "argv", [[], ["service"], ["interface"], ["node"], ["service", "call", "-h"], ["ps", "-h"]]
)
def test_help_is_exit_0(argv, capsys):
    try:
        code = main(argv)
    except SystemExit as end:
        code = end.code
    assert code == 0
    assert capsys.readouterr().out.startswith("usage: taskrpc")


@pytest.mark.parametrize("argv", [["nope"], ["service", "nope"], ["--nope"], ["node", "info"]])
def test_wrong_usage_is_exit_2_and_shows_the_usage(argv, capsys):
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("usage: taskrpc")
    assert ": error: " in err


def test_unknown_command_is_reported(capsys):
    main(["servic", "list"])
    assert "error: unknown command 'servic'" in capsys.readouterr().err


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("taskrpc ")


def printed_by(program):
    """What a program prints in a Python of its own."""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True
    )
    return done.stdout


def test_command_does_not_import_modules_of_other_commands():
    program = (
        "import sys; from taskrpc.cli.main import main; main([]);"
        "unwanted = {'asyncio', 'msgspec', 'yaml', 'srvgen.definitions.names', 'rich'};"
        "print(sorted(unwanted & set(sys.modules)))"
    )
    assert printed_by(program).splitlines()[-1] == "[]"


def test_call_does_not_import_robot_tasks_or_rich():
    program = (
        "import sys; from taskrpc.cli import call; from taskrpc.cli.shared import calling;"
        "print([m for m in sys.modules if m.split('.')[:2] in"
        " (['taskrpc', 'robot'], ['taskrpc', 'tasks'], ['taskrpc', 'sync'])"
        " or m in ('rich', 'sqlite3', 'uvloop', 'importlib.metadata')])"
    )
    assert printed_by(program).strip() == "[]"


def test_a_program_that_only_calls_does_not_import_the_serving_side():
    program = (
        "import sys, asyncio, srvgen, taskrpc\n"
        "from taskrpc.cli import call\n"
        "from taskrpc.cli.shared import calling\n"
        "async def main():\n"
        "    async with taskrpc.Node('caller') as node:\n"
        "        node.create_client(srvgen.load('std_srvs/srv/Empty'), 'empty')\n"
        "asyncio.run(main())\n"
        "serving = {'server_side', 'incoming_call', 'admission', 'calls_in_flight', 'backpressure',"
        " 'listening', 'accounts', 'server_threads', 'listen_policy', 'memory',"
        " 'publishing', 'ledger', 'graph'}\n"
        "ours = [each for each in sys.modules if each.startswith('taskrpc.')]\n"
        "print([x for x in ours if x.rpartition('.')[2] in serving or x[8:] == 'service'])"
    )
    assert printed_by(program).strip() == "[]"


def test_a_program_that_only_serves_imports_little():
    program = (
        "import sys, asyncio, srvgen, taskrpc\n"
        "async def main():\n"
        "    before = set(sys.modules)\n"
        "    async with taskrpc.Node('server') as node:\n"
        "        node.create_service(srvgen.load('std_srvs/srv/Empty'), 'empty', print)\n"
        "        print(*set(sys.modules) - before)\n"
        "asyncio.run(main())"
    )
    modules = printed_by(program).split()
    calling = (
        "taskrpc.client taskrpc.retry taskrpc.core.attempts taskrpc.core.transport.channel"
        " taskrpc.core.transport.connection.dialling"
        " taskrpc.core.transport.connection.client_side"
        " taskrpc.core.transport.connection.client_threads"
    )
    others = "dataclasses queue random secrets zlib"
    assert sorted(set(modules) & set(f"{calling} {others}".split())) == []
    ours = sorted(each for each in modules if each.startswith(("taskrpc.", "srvgen.")))
    assert len(ours) <= MODULES_OF_A_SERVER, ours


def test_main_with_arguments_does_not_change_the_process(monkeypatch):
    frozen = []
    monkeypatch.setattr(command.gc, "freeze", lambda: frozen.append(True))
    main(["--version"])
    assert not frozen


def test_garbage_collection_of_a_long_run_is_short_and_skips_imported_objects():
    program = (
        "import gc; from taskrpc.cli.shared import command\n"
        "def action(_):\n"
        "    command.tune_for_long_run()\n"
        "    print(gc.get_threshold()[0], gc.get_freeze_count())\n"
        "    return 0\n"
        "command.run_main(action, None)"
    )
    few, frozen = map(int, printed_by(program).split())
    assert few <= 10_000
    assert frozen > 1000


def test_long_run_in_a_foreign_process_leaves_its_garbage_collector_unchanged(monkeypatch):
    monkeypatch.setattr(command.gc, "freeze", pytest.fail)
    before = command.gc.get_threshold()
    command.tune_for_long_run()
    assert command.gc.get_threshold() == before


def test_command_that_only_ros2_has_gets_one_line_of_advice(capsys):
    assert main(["control", "list_controllers"]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == (
        "",
        "taskrpc has no command 'control': there is no controller manager\n",
    )


@pytest.mark.parametrize(
    ("argv", "hint"),
    [(["servce"], "service"), (["service", "lst"], "list"), (["task", "submt"], "submit")],
)
def test_mistyped_command_gets_a_hint(argv, hint, capsys):
    assert main(argv) == 2
    assert capsys.readouterr().err.endswith(f"hint: did you mean {hint}?\n")


@pytest.mark.parametrize("name", ["talkr.py", "talkr", "./talkre.py"])
def test_mistyped_script_gets_a_hint(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "talker.py").touch()
    assert main(["run", name]) == 1
    assert capsys.readouterr().err.endswith("hint: did you mean talker.py?\n")


def test_server_that_a_signal_ends_is_done_unless_the_user_pressed_ctrl_c():
    assert exit_after(signal.SIGTERM) is Exit.DONE
    assert exit_after(signal.SIGINT) is Exit.INTERRUPTED
