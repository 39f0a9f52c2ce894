"""`taskrpc service` and `taskrpc-call` against a real server: output, errors and exit codes."""

from __future__ import annotations

import io
import json
import os
import re
import signal

import pytest

from taskrpc.cli.call import main as call_main

pytestmark = pytest.mark.real_time

ADD = "example_interfaces/srv/AddTwoInts"


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


def test_address_without_a_program_is_an_error(server, run):
    code, out, err = run("service", "list", "--connect", "127.0.0.1:9")
    assert (code, out) == (4, "")
    assert "127.0.0.1:9" in err


@pytest.mark.parametrize("name", ["/add_two_ints", "add_two_ints"])
def test_service_type(server, run, name):
    assert run("service", "type", name) == (0, f"{ADD}\n", "")


def test_lookup_that_finds_nothing_exits_with_1_and_suggests_similar_names(server, run):
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


def test_service_find_of_an_unused_type_prints_nothing(server, run):
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


def test_unknown_service_exits_with_4_and_suggests_similar_names(server, run):
    code, out, err = run("/ad_two_ints", "--timeout", "0.1", command=call_main)
    assert (code, out) == (4, "")
    assert err == (
        "waiting for service to become available...\n"
        "no server offers /ad_two_ints (waited 0.1 s)\n"
        "  hint: did you mean /add_two_ints?\n"
    )


def test_service_of_another_domain_is_suggested(server, run, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    _, _, err = run("/add_two_ints", "--timeout", "0.1", command=call_main)
    assert "it is offered in domain 0; set ROS_DOMAIN_ID=0" in err


def test_hint_says_how_to_start_a_program_if_none_runs(run):
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
        (("/sleep", "--timeout", "0.2"), 3, "no response from /sleep within 0.2 s"),
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


def test_connection_lost_during_the_call_is_an_unknown_outcome(own_server, run):
    code, _, err = run("/end", command=call_main)
    assert (code, err.count("\n")) == (5, 1)


@pytest.mark.parametrize("data", [b"{a: 11}", b"\xef\xbb\xbfa: 11\r\n", "{a: 11}".encode("utf-16")])
def test_standard_input_may_be_utf8_or_what_windows_tools_write(server, run, monkeypatch, data):
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))
    argv = ("add_two_ints", "--stdin", "--json")
    assert run(*argv, command=call_main) == (0, '{"sum": 11}\n', "")


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_stopped_server_is_reported_with_the_command_that_continues_it(own_server, run):
    pid = own_server.process.pid
    os.kill(pid, signal.SIGSTOP)
    os.waitpid(pid, os.WUNTRACED)
    code, out, err = run("/add_two_ints", "--timeout", "0.3", command=call_main)
    assert (code, out) == (4, "")
    said = f"adder.py (pid {pid}) offers /add_two_ints, but is stopped, as by Ctrl-Z (waited 0.3 s)"
    assert f"{said}\n  hint: `fg` in its terminal or `kill -CONT {pid}` continues it" in err


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_server_that_hangs_is_reported(own_server, run, monkeypatch):
    os.kill(own_server.process.pid, signal.SIGSTOP)
    monkeypatch.setattr("taskrpc.core.system.process_state.is_stopped", lambda _: False)
    code, out, err = run("/add_two_ints", "--timeout", "0.3", command=call_main)
    assert (code, out) == (4, "")
    pid = own_server.process.pid
    assert f"adder.py (pid {pid}) offers /add_two_ints but does not answer (waited 0.3 s)\n" in err
    assert f"hint: find out why: taskrpc doctor {own_server.address}\n" in err
