"""`taskrpc-server` refuses what it cannot start with: one clear line, before it serves."""

import socket
import sys

import pytest

from taskrpc.cli.robot.server import command_line as server_module
from taskrpc.cli.robot.server.command_line import main
from taskrpc.core.security.lab import Lab, remember_lab
from taskrpc.robot.tasks import History

ROBOT = """
import asyncio

class Lamp:
    def __init__(self, world):
        self.task_types = ("blink",)

class Broken:
    def __init__(self):
        raise OSError("no lamp is connected")
"""


@pytest.fixture
def server(run, tmp_path, monkeypatch):
    """Runs `taskrpc-server` in this process, in an empty folder: exit code and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "my_lamp", raising=False)

    def _server(*argv):
        code, out, err = run("--db", ":memory:", *argv, command=main)
        assert out == ""
        return code, err

    return _server


def test_invalid_map_is_reported_with_its_line(server, tmp_path):
    code, err = server("--map", "nowhere.yaml")
    assert code == 1
    assert err.startswith("nowhere.yaml: error: cannot read the map: ")
    (tmp_path / "small.yaml").write_text("size: [4, 4]\ndock: [9, 1]\n", encoding="utf-8")
    code, err = server("--map", "small.yaml")
    assert code == 1
    assert err.startswith("small.yaml:2:7: error: dock reaches to 9, 1, outside the map")
    assert "    dock: [9, 1]\n" in err


@pytest.mark.parametrize(
    ("spec", "problem"),
    [
        ("my_lamp", "expected MODULE:CLASS"),
        ("nowhere:Robot", "No module named 'nowhere'"),
        ("my_lamp:Robot", "my_lamp has no Robot"),
        ("my_lamp:asyncio", "--robot my_lamp:asyncio: "),
        ("my_lamp:Broken", "--robot my_lamp:Broken: OSError: no lamp is connected"),
        ("my_lamp:Lamp", "the class lacks speed, plan, pose, execute"),
    ],
)
def test_unusable_robot_class_is_named(server, tmp_path, spec, problem):
    (tmp_path / "my_lamp.py").write_text(ROBOT, encoding="utf-8")
    code, err = server("--robot", spec)
    assert code == 1
    assert problem in err


@pytest.mark.parametrize(
    "options", [["--settle", "-1"], ["--speed", "0"], ["--queue-limit", "0"], ["--share", "some"]]
)
def test_option_out_of_range_is_named(server, options):
    code, err = server(*options)
    assert code == 2
    assert f"argument {options[0]}: expected a " in err


@pytest.mark.parametrize(
    ("given", "history"),
    [
        ([], History()),
        (["--history", "250000"], History(count=250_000)),
        (["--history", "30d"], History(count=None, seconds=30 * 86_400.0)),
    ],
)
@pytest.mark.parametrize("database", ["tasks.db", ":memory:"])
def test_history_is_a_number_of_tasks_or_of_days(tmp_path, given, history, database):
    path = database if database == ":memory:" else str(tmp_path / database)
    store = server_module._store(server_module._parser().parse_args(["--db", path, *given]))
    kept = store.history
    assert (kept.count, kept.seconds) == (history.count, history.seconds)


@pytest.mark.parametrize("given", ["0", "-5", "d", "0d", "1.5d", "30 d", "12h", "²"])
def test_wrong_history_is_refused(server, given):
    code, err = server(f"--history={given}")
    assert code == 2
    rule = "a number of tasks such as 100000, or of days such as 30d"
    assert f"argument --history: expected {rule}, got {given!r}" in err


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--allow-origin", "lab:8000"], "expected an origin such as http://lab.local:8000"),
        (["--allow-origin", "http://lab.local:8000"], "give --web too"),
    ],
)
def test_unusable_origin_is_refused(server, options, problem):
    code, err = server(*options)
    assert code == 2
    assert problem in err


def test_unknown_fault_is_refused_with_a_list_of_what_is_allowed(server):
    code, err = server("--fault", "lose")
    assert code == 2
    line = err.splitlines()[-1]
    assert "argument --fault: expected a fault, got 'lose'" in line
    assert "allowed are lose-request, duplicate-request, lose-response, delay-response:0.5s" in line


@pytest.mark.parametrize("options", [["--fresh"], ["--db", ":memory:"]])
def test_standby_refuses_options_that_start_with_other_tasks(run, options):
    code, _, err = run("--standby", *options, command=main)
    assert code == 2
    refused = f"--standby continues the tasks of another server; do not use it with {options[0]}"
    assert refused in err


@pytest.mark.real_time
@pytest.mark.parametrize("option", ["--listen", "--web"])
def test_server_that_cannot_start_leaves_no_recording(server, tmp_path, option):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        code, err = server("--record", "run.mcap", option, place)
    assert code == 1
    assert f"cannot listen at {place}" in err
    assert not (tmp_path / "run.mcap").exists()


@pytest.mark.parametrize(
    "options",
    [["--map", "nowhere.yaml"], ["--tls-cert", "nowhere.pem", "--tls-key", "nowhere.pem"]],
)
def test_server_with_a_mistake_leaves_no_recording(server, tmp_path, options):
    assert server("--record", "run.mcap", *options)[0] in (1, 2)
    assert not (tmp_path / "run.mcap").exists()


def test_recording_never_replaces_a_file(server, tmp_path):
    (tmp_path / "run.mcap").write_bytes(b"precious")
    code, err = server("--record", "run.mcap", "--tls-cert", "nowhere.pem")
    assert code in (1, 2)
    code, err = server("--record", "run.mcap")
    assert code == 1
    assert err == (
        "cannot record to run.mcap: the file exists already; choose another name or remove it\n"
    )
    assert (tmp_path / "run.mcap").read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "your calls of /robot_task come here, not to the lab's robot"),
        (["--namespace", "/robot2"], "your calls of /robot2/robot_task come here"),
        (["--namespace", "/local"], ""),
        (["--transport", "ros"], ""),
        (["--class", "folder"], ""),
    ],
)
def test_server_says_that_it_takes_the_calls_of_a_joined_laptop(monkeypatch, options, said):
    remember_lab(Lab(address="h:1", token="ada.secret", certificate="PEM", namespace="/robot2/ada"))
    parsed = server_module._parser().parse_args(options)
    line = server_module._in_place_of_a_lab(parsed)
    assert said in line
    assert bool(line) == bool(said)
    assert not line or line.startswith("you have joined the lab at h:1: ")
    monkeypatch.setenv("TASKRPC_PEERS", "h:2")
    assert server_module._in_place_of_a_lab(parsed) == ""
