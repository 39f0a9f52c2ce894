"""`taskrpc service`, `node`, `ps` and `stop` print what ros2 prints, about a real server."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest

from taskrpc.cli.call import main as call_main
from taskrpc.cli.main import main
from taskrpc.cli.shared.processes import Process
from taskrpc.transport.discovery.entries import Entry
from taskrpc.wire.messages import Endpoint, TopicEndpoint

pytestmark = pytest.mark.real_time

ADD = "example_interfaces/srv/AddTwoInts"


@pytest.fixture
def run(capsys):
    """Runs `taskrpc …` in this process: exit code, stdout, stderr."""

    def _run(*argv, command=main):
        code = command(argv)
        out, err = capsys.readouterr()
        return code, out, err

    return _run


def test_service_list(server, run):
    assert run("service", "list") == (0, "/add_two_ints\n/end\n/fail\n/refuse\n/sleep\n", "")
    assert run("service", "list", "-c") == (0, "5\n", "")
    out = run("service", "list", "-t")[1]
    assert out.splitlines()[:2] == [f"/add_two_ints [{ADD}]", "/end [std_srvs/srv/Empty]"]


@pytest.mark.parametrize(
    "argv",
    [
        ("service", "list", "--include-hidden-services"),
        ("service", "--include-hidden-services", "list"),
    ],
)
def test_hidden_services_are_listed_on_request(server, run, argv):
    assert run(*argv)[1].startswith("/_hidden\n/add_two_ints\n")


def test_service_list_as_json(server, run):
    found = json.loads(run("service", "list", "--json")[1])
    assert found[0] == {"name": "/add_two_ints", "types": [ADD]}


def test_a_listing_from_the_named_program_is_the_same(server, run):
    here = run("service", "list", "-t")
    assert run("service", "list", "-t", "--connect", server.address) == here


def test_nobody_at_the_named_address_is_an_error(server, run):
    code, out, err = run("service", "list", "--connect", "127.0.0.1:9")
    assert (code, out) == (4, "")
    assert "127.0.0.1:9" in err


@pytest.mark.parametrize("name", ["/add_two_ints", "add_two_ints"])
def test_service_type(server, run, name):
    assert run("service", "type", name) == (0, f"{ADD}\n", "")


def test_a_look_up_that_finds_nothing_is_exit_1_and_names_what_is_near(server, run):
    code, out, err = run("service", "type", "/add_two_in")
    assert (code, out) == (1, "")
    assert err == "Unknown service '/add_two_in'\n  hint: did you mean /add_two_ints?\n"
    code, out, err = run("service", "info", "/nope")
    assert (code, out) == (1, "")
    assert err.startswith("Unknown service '/nope'\n")


def test_service_info(server, run):
    summary = f"Type: {ADD}\nClients count: 1\nServices count: 1\n"
    assert run("service", "info", "/add_two_ints") == (0, summary, "")
    out = run("service", "info", "-v", "/add_two_ints")[1]
    clients, _, servers = out.partition("Services count: 1\n\nNode name: add_two_ints_server\n")
    assert clients.startswith(f"Type: {ADD}\nClients count: 1\n\nNode name: other\n")
    assert "Endpoint type: SERVER\nEndpoint count: 1\nGID: " in servers
    assert len(re.findall(r"^GID: (?:[0-9a-f]{2}\.){15}[0-9a-f]{2}$", out, re.MULTILINE)) == 2
    assert "QoS profile:\n  Reliability: RELIABLE\n  History (Depth): KEEP_LAST (10)\n" in servers
    assert out.endswith("\n\n")
    assert "Node name: add_two_ints_server\nNode namespace: /\n" in out
    assert "Node name: other\n" in out
    assert "Service type hash: RIHS01_e118de6bf5eeb66a" in out
    assert f"Process: adder.py (pid {server.process.pid}, in {server.folder})\n" in out


def test_service_info_as_json(server, run):
    facts = json.loads(run("service", "info", "add_two_ints", "--json")[1])
    assert (facts["Type"], facts["Clients count"], facts["Services count"]) == (ADD, 1, 1)
    assert [one["Endpoint type"] for one in facts["Endpoints"]] == ["SERVER", "CLIENT"]


@pytest.mark.parametrize("type_name", [ADD, "example_interfaces/AddTwoInts"])
def test_service_find(server, run, type_name):
    assert run("service", "find", type_name) == (0, "/add_two_ints\n", "")
    assert run("service", "find", "-c", type_name) == (0, "1\n", "")


def test_service_find_of_a_type_that_nobody_offers_prints_nothing(server, run):
    assert run("service", "find", "std_srvs/srv/SetBool") == (0, "", "")


def test_service_call_and_taskrpc_call_are_the_same(server, run):
    short = run("/add_two_ints", ADD, "{a: 2, b: 3}", command=call_main)
    assert run("service", "call", "/add_two_ints", ADD, "{a: 2, b: 3}") == short
    assert short[1].endswith("\nresponse:\nexample_interfaces.srv.AddTwoInts_Response(sum=5)\n\n")


def test_options_may_stand_anywhere_in_a_call(server, run):
    for argv in (
        ("--json", "add_two_ints", "a=2", "b=3"),
        ("add_two_ints", "--json", "a=2", "b=3"),
        ("add_two_ints", "a=2", "--timeout", "5", "b=3", "--json"),
    ):
        assert run(*argv, command=call_main) == (0, '{"sum": 5}\n', "")
        assert run("service", "call", *argv) == (0, '{"sum": 5}\n', "")


def test_an_unknown_service_is_exit_4_and_names_what_is_near(server, run):
    code, out, err = run("/ad_two_ints", "--timeout", "0.1", command=call_main)
    assert (code, out) == (4, "")
    assert err == (
        "waiting for service to become available...\n"
        "nobody offers /ad_two_ints (waited 0.1 s)\n"
        "  hint: did you mean /add_two_ints?\n"
    )


def test_an_unknown_service_of_another_domain_is_named(server, run, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    _, _, err = run("/add_two_ints", "--timeout", "0.1", command=call_main)
    assert "it is offered in domain 0; set ROS_DOMAIN_ID=0" in err


def test_where_no_program_runs_the_message_says_how_to_start_one(run):
    code, _, err = run("/robot_task", "--timeout", "0.1", command=call_main)
    assert code == 4
    assert "no taskrpc program offers a service on this machine" in err
    assert "taskrpc-server" in err


def test_with_json_an_error_is_one_line_of_json(server, run):
    code, out, err = run("/nope", "--timeout", "0.1", "--json", command=call_main)
    assert (code, out) == (4, "")
    assert json.loads(err)["error"] == "ServiceUnavailable"
    code, _, err = run("service", "type", "/nope", "--json")
    assert (code, json.loads(err)["error"]) == (1, "NotFound")
    code, _, err = run("add_two_ints", "--rate", "0", "--json", command=call_main)
    assert (code, json.loads(err)["error"]) == (2, "UsageError")


@pytest.mark.parametrize(
    ("argv", "code", "message"),
    [
        (("/fail",), 1, "the handler failed; see the server's log"),
        (("/refuse",), 1, "the table is full"),
        (("/sleep", "--timeout", "0.2"), 3, "no answer from /sleep within 0.2 s"),
        (("/add_two_ints", "a=x"), 1, "Failed to populate field: a: expected int64"),
        (("/bad name",), 1, "  '/bad name'\n       ^\n"),
        (("C:/Program Files/Git/add_two_ints",), 1, "Git Bash"),
        (("/add_two_ints", "foo/srv/Bar", "{}"), 1, "The passed service type is invalid"),
        (("/add_two_ints", "std_msgs/msg/String", "{}"), 1, "The passed type is not a service"),
        (("/add_two_ints", "std_srvs/srv/Empty"), 1, f"is offered as {ADD}"),
        ((), 2, "the following arguments are required: service_name"),
        (("/add_two_ints", "--nope"), 2, "unrecognized arguments: --nope"),
        (("/add_two_ints", "-r", "-1"), 2, "expected a number greater than zero, got '-1'"),
        (("/add_two_ints", "--count", "0"), 2, "expected a whole number from 1 on, got '0'"),
        (("/add_two_ints", "--timeout", "nan"), 2, "--timeout: expected seconds, or 0 or inf"),
        (("/add_two_ints", "--timeout", "-1"), 2, "--timeout: expected seconds, or 0 or inf"),
        (("/add_two_ints", "--stdin", "a=1"), 2, "--stdin"),
        (("/add_two_ints", "--connect", "nowhere"), 2, "expected HOST:PORT"),
        (("/add_two_ints", "--token-file", "/none"), 1, "--token-file /none"),
    ],
)
def test_each_failure_has_its_exit_code_and_message(server, run, argv, code, message):
    got, _, err = run(*argv, command=call_main)
    assert got == code, err
    assert message in err
    assert "Traceback" not in err


def test_a_connection_lost_in_mid_call_is_an_unknown_outcome(own_server, run):
    code, _, err = run("/end", command=call_main)
    assert (code, err.count("\n")) == (5, 1)


@pytest.mark.parametrize("data", [b"{a: 11}", b"\xef\xbb\xbfa: 11\r\n", "{a: 11}".encode("utf-16")])
def test_standard_input_may_be_utf8_or_what_windows_tools_write(server, run, monkeypatch, data):
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))
    argv = ("add_two_ints", "--stdin", "--json")
    assert run(*argv, command=call_main) == (0, '{"sum": 11}\n', "")


def test_node_list(server, run):
    assert run("node", "list") == (0, "/add_two_ints_server\n/other\n", "")
    assert run("node", "list", "-c") == (0, "2\n", "")
    assert json.loads(run("node", "list", "--json")[1]) == ["/add_two_ints_server", "/other"]


def test_node_info(server, run):
    code, out, _ = run("node", "info", "add_two_ints_server")
    assert (code, out) == (
        0,
        "/add_two_ints_server\n"
        "  Subscribers:\n\n"
        "  Publishers:\n\n"
        "  Service Servers:\n"
        f"    /add_two_ints: {ADD}\n"
        "  Service Clients:\n\n"
        "  Action Servers:\n\n"
        "  Action Clients:\n\n",
    )
    out = run("node", "info", "/other")[1]
    assert f"  Service Clients:\n    /add_two_ints: {ADD}\n  Action Servers:\n\n" in out
    assert "/_hidden" in run("node", "info", "/add_two_ints_server", "--include-hidden")[1]


def test_node_info_has_the_topics_of_a_node(server, run):
    assert run("node", "info", "/other")[1].splitlines()[:5] == [
        "/other",
        "  Subscribers:",
        "    /heard: std_msgs/msg/String",
        "  Publishers:",
        "    /told: std_msgs/msg/String",
    ]


def test_node_info_of_an_unknown_node(server, run):
    code, out, err = run("node", "info", "/othr")
    assert (code, out) == (1, "")
    assert err == "Unable to find node '/othr'\n  hint: did you mean /other?\n"


def test_ps_says_who_runs_where_since_when_and_what_for(server, run):
    heading, row = run("ps")[1].splitlines()
    assert heading.split() == ["PID", "SINCE", "DOMAIN", "SCRIPT", "FOLDER", "SERVICES"]
    assert row.startswith(str(server.process.pid))
    assert str(server.folder) in row
    assert row.endswith("/sleep")
    (facts,) = json.loads(run("ps", "--json")[1])
    assert facts["script"] == "adder.py"
    assert facts["folder"] == str(server.folder)
    assert facts["services"] == ["/add_two_ints", "/end", "/fail", "/refuse", "/sleep"]
    assert 0 <= time.time() - facts["since"] < 600


def test_ps_with_nobody_running(run):
    assert run("ps", "--json") == (0, "[]\n", "")


@pytest.mark.parametrize("name", ["17", "adder", "adder.py", "/other", "other", "/add", "add"])
def test_a_program_is_meant_by_pid_script_node_or_service(name):
    service = Endpoint("/add", ADD, "", "/other")
    entry = Entry(17, "adder.py", "/home", 0.0, nodes=("/other",), services=(service,))
    assert Process(0, (entry,)).is_meant_by(name)
    assert not Process(0, (entry,)).is_meant_by(name + "x")


@pytest.mark.parametrize(
    "name", ["server.py", "server", "08_debugging/server.py", "/home/a/08_debugging/server.py"]
)
def test_a_script_is_meant_by_the_end_of_its_path_wherever_it_was_started(name):
    entry = Entry(42, "08_debugging/server.py", "/home/a", 0.0)
    assert Process(0, (entry,)).is_meant_by(name)
    assert not Process(0, (entry,)).is_meant_by("erver.py")
    assert not Process(0, (entry,)).is_meant_by(f"b/{name}")


def test_stop_ends_the_only_program(own_server, run):
    assert run("stop") == (0, f"stopped adder.py (pid {own_server.process.pid})\n", "")
    # Windows cannot ask a process to end, it can only end it.
    assert own_server.process.wait(30) == (15 if sys.platform == "win32" else 0)


def test_stop_all_and_then_nobody_is_left(own_server, run):
    assert run("stop", "--all")[0] == 0
    assert run("stop", "--all") == (0, "no taskrpc program runs\n", "")


def test_stop_of_a_stranger_ends_nobody(server, run):
    code, out, err = run("stop", str(os.getpid()))
    assert (code, out) == (1, "")
    assert f"there are adder.py (pid {server.process.pid})" in err
    assert server.process.poll() is None


def test_a_program_that_does_not_react_is_reported(server, run, monkeypatch):
    monkeypatch.setattr("taskrpc.platform.end_process", lambda pid, at_once: None)
    monkeypatch.setattr("taskrpc.cli.stop.PATIENCE", 0.1)
    code, _, err = run("stop", "adder")
    assert code == 1
    who = f"adder.py (pid {server.process.pid})"
    assert err.startswith(f"still running after 0.1 s: {who}\n  hint: {who} does not react: ")
    assert "--force ends it at once" in err


SLOW = """
import asyncio, srvgen, taskrpc

async def sleep(request, response):
    await asyncio.sleep(60)
    return response

async def main():
    async with taskrpc.Node("slow") as node:
        node.create_service(srvgen.load("std_srvs/srv/Empty"), "sleep", sleep)
        await node.spin()

taskrpc.run(main())
"""


@pytest.mark.skipif(os.name != "posix", reason="on Windows nobody is asked to end")
def test_a_program_that_still_answers_calls_is_told_from_one_that_is_stuck(
    tmp_path, run, monkeypatch
):
    monkeypatch.setattr("taskrpc.cli.stop.PATIENCE", 1.0)
    (tmp_path / "slow.py").write_text(SLOW, encoding="utf-8")
    call = [sys.executable, "-m", "taskrpc.cli.call", "/sleep", "--timeout", "60"]
    with (
        subprocess.Popen([sys.executable, "slow.py"], cwd=tmp_path) as slow,
        subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as calling,
    ):
        while not calling.stdout.readline().startswith("requester:"):
            pass
        time.sleep(0.2)  # for the request to arrive
        code, _, err = run("stop", "slow")
        assert code == 1
        assert f"hint: slow.py (pid {slow.pid}) answers the calls that it has begun, then" in err
        code, out, _ = run("ps")
        assert out.splitlines()[1].endswith("  - (ending)")
        (facts,) = json.loads(run("ps", "--json")[1])
        assert facts["state"] == "ending"
        code, out, _ = run("doctor")
        assert (code, "slow.py" in out, "it answers its last calls" in out) == (0, True, True)
        assert run("stop", "--force", "slow")[0] == 0


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_a_program_that_ctrl_z_stopped_is_shown_and_can_be_ended(own_server, run):
    os.kill(own_server.process.pid, signal.SIGSTOP)
    os.waitpid(own_server.process.pid, os.WUNTRACED)  # until it stands
    code, out, _ = run("ps")
    assert (code, out.splitlines()[1].endswith(" (stopped)")) == (0, True)
    assert json.loads(run("ps", "--json")[1])[0]["state"] == "stopped"
    assert run("stop") == (0, f"stopped adder.py (pid {own_server.process.pid})\n", "")


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_a_server_that_was_stopped_is_named_with_how_it_goes_on(own_server, run):
    pid = own_server.process.pid
    os.kill(pid, signal.SIGSTOP)
    os.waitpid(pid, os.WUNTRACED)
    code, out, err = run("/add_two_ints", "--timeout", "0.3", command=call_main)
    assert (code, out) == (4, "")
    said = f"adder.py (pid {pid}) offers /add_two_ints, but is stopped, as by Ctrl-Z (waited 0.3 s)"
    assert f"{said}\n  hint: `fg` in its terminal or `kill -CONT {pid}` continues it" in err


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_a_server_that_hangs_is_named(own_server, run, monkeypatch):
    os.kill(own_server.process.pid, signal.SIGSTOP)
    monkeypatch.setattr("taskrpc.platform.is_stopped", lambda _: False)
    code, out, err = run("/add_two_ints", "--timeout", "0.3", command=call_main)
    assert (code, out) == (4, "")
    pid = own_server.process.pid
    assert f"adder.py (pid {pid}) offers /add_two_ints but does not answer (waited 0.3 s)\n" in err
    assert f"hint: find out why: taskrpc doctor {own_server.address}\n" in err


def test_nodes_of_one_name_are_warned_of(run, monkeypatch):
    there = [
        Entry(1, "n.py", "/home", 0.0, nodes=("/twin", "/one")),
        Entry(2, "n.py", "/home", 0.0, nodes=("/twin",)),
    ]
    monkeypatch.setattr("taskrpc.cli.shared.graph.look", lambda remote: there)
    assert run("node", "list", "--count") == (0, "3\n", "")
    assert run("node", "list") == (
        0,
        "/one\n/twin\n/twin\n",
        "WARNING: Be aware that there are nodes in the graph that share an exact name,"
        " which can have unintended side effects.\n",
    )
    code, out, err = run("node", "info", "/twin")
    assert (code, out.splitlines()[0]) == (0, "/twin")
    assert err == (
        'There are 2 nodes in the graph with the exact name "/twin".'
        " You are seeing information about all of them.\n"
    )
    assert run("node", "info", "/one")[2] == ""


HIDDEN = Entry(
    1,
    "n.py",
    "/home",
    0.0,
    nodes=("/lab/_secret", "/_lab/plain", "/seen"),
    services=tuple(Endpoint(name, ADD, "", "/seen") for name in ("/a", "/a/_b", "/_c/d")),
    publishers=tuple(
        TopicEndpoint(name, "std_msgs/msg/String", "", "/seen", 1, True, False)
        for name in ("/t", "/t/_u", "/_v/w")
    ),
)


@pytest.mark.parametrize(
    ("listing", "option", "seen", "hidden"),
    [
        (("node", "list"), "-a", ["/seen"], ["/_lab/plain", "/lab/_secret"]),
        (("node", "list"), "--all", ["/seen"], ["/_lab/plain", "/lab/_secret"]),
        (("service", "list"), "--include-hidden-services", ["/a"], ["/_c/d", "/a/_b"]),
        (("service", "find", ADD), "--include-hidden-services", ["/a"], ["/_c/d", "/a/_b"]),
        (("topic", "list"), "--include-hidden-topics", ["/t"], ["/_v/w", "/t/_u"]),
        (("topic", "list"), "-a", ["/t"], ["/_v/w", "/t/_u"]),
        (
            ("topic", "find", "std_msgs/String"),
            "--include-hidden-topics",
            ["/t"],
            ["/_v/w", "/t/_u"],
        ),
    ],
)
def test_names_with_a_hidden_part_are_listed_and_counted_on_request_only(
    run, monkeypatch, listing, option, seen, hidden
):
    monkeypatch.setattr("taskrpc.cli.shared.graph.look", lambda remote: [HIDDEN])
    everything = sorted(seen + hidden)
    assert run(*listing)[1].split() == seen
    assert run(*listing, option)[1].split() == everything
    for count in ("-c", "--count"):
        assert run(*listing, count) == (0, f"{len(seen)}\n", "")
        assert run(*listing, count, option) == (0, f"{len(everything)}\n", "")


def test_lists_of_nothing_print_nothing_and_count_0(run, monkeypatch):
    monkeypatch.setattr("taskrpc.cli.shared.graph.look", lambda remote: [])
    for kind in ("node", "service", "topic"):
        assert run(kind, "list") == (0, "", "")
        assert run(kind, "list", "-c") == (0, "0\n", "")
    assert run("topic", "list", "-v") == (0, "", "")
