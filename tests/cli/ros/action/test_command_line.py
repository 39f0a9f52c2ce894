"""`taskrpc action` lists actions as ros2 does, and completes their names."""

from __future__ import annotations

import json

import pytest

from tests.cli.completing import completed

pytestmark = pytest.mark.real_time

TYPE = "example_interfaces/action/Fibonacci"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("list", "/fibonacci"),
        ("list -t", f"/fibonacci [{TYPE}]"),
        ("list -c", "1"),
        ("find example_interfaces/Fibonacci", "/fibonacci"),
        ("find test_msgs/action/Fibonacci -c", "0"),
        ("type fibonacci", TYPE),
        ("type /fibonacci --json", f'["{TYPE}"]'),
    ],
)
def test_listings(action, run, line, expected):
    assert run("action", *line.split()) == (0, f"{expected}\n", "")


def test_info_names_the_nodes(action, run):
    counts = "Action: /fibonacci\nAction clients: 1\nAction servers: 1\n"
    assert run("action", "info", "-c", "/fibonacci") == (0, counts, "")
    out = run("action", "info", "-t", "/fibonacci")[1]
    clients = f"Action clients: 1\n    /user [{TYPE}]\n"
    assert out == f"Action: /fibonacci\n{clients}Action servers: 1\n    /server [{TYPE}]\n"
    assert "    /server\n" in run("action", "info", "/fibonacci")[1]


def test_info_about_an_action_that_no_program_has_counts_none(action, run):
    out = "Action: /nope\nAction clients: 0\nAction servers: 0\n"
    assert run("action", "info", "/nope") == (0, out, "")


def test_json(action, run):
    assert json.loads(run("action", "list", "--json")[1]) == [
        {"name": "/fibonacci", "types": [TYPE]}
    ]
    assert json.loads(run("action", "info", "/fibonacci", "--json")[1]) == {
        "name": "/fibonacci",
        "types": [TYPE],
        "clients": {"/user": TYPE},
        "servers": {"/server": TYPE},
    }


def test_an_unknown_action_is_one_line_with_a_suggestion(action, run):
    code, out, err = run("action", "type", "/fibonaci")
    assert (code, out) == (1, "")
    assert err == "Unknown action '/fibonaci'\n  hint: did you mean /fibonacci?\n"


def test_node_info_lists_actions_and_hides_their_parts(action, run):
    out = run("node", "info", "/server")[1]
    assert out.endswith(f"  Action Servers:\n    /fibonacci: {TYPE}\n  Action Clients:\n\n")
    assert "_action" not in out
    assert f"  Action Clients:\n    /fibonacci: {TYPE}\n" in run("node", "info", "/user")[1]
    assert "_action" in run("node", "info", "/server", "--include-hidden")[1]


def test_parts_of_actions_are_hidden_topics_and_services(action, run):
    for kind in ("topic", "service"):
        assert "_action" not in run(kind, "list")[1]
        hidden = run(kind, "list", f"--include-hidden-{kind}s")[1]
        assert "/fibonacci/_action/" in hidden


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("action se", ["send_goal"]),
        ("action info /fi", ["/fibonacci"]),
        ("action send_goal /fi", ["/fibonacci"]),
        ("action send_goal /fibonacci ", [TYPE]),
        ("action send_goal /new test_msgs/action/Fib", ["test_msgs/action/Fibonacci"]),
        ("action echo /fibonacci ", [TYPE]),
        ("action find example_interfaces/action/F", [TYPE]),
    ],
)
def test_tab_completes(action, monkeypatch, line, expected):
    assert completed(line, monkeypatch) == expected
