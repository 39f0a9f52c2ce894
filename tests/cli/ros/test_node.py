"""`taskrpc node` prints what ros2 prints."""

from __future__ import annotations

import json

import pytest

from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint

pytestmark = pytest.mark.real_time

ADD = "example_interfaces/srv/AddTwoInts"


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


def test_nodes_with_the_same_name_cause_a_warning(run, monkeypatch):
    there = [
        RegistryEntry(1, "n.py", "/home", 0.0, nodes=("/twin", "/one")),
        RegistryEntry(2, "n.py", "/home", 0.0, nodes=("/twin",)),
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


HIDDEN = RegistryEntry(
    1,
    "n.py",
    "/home",
    0.0,
    nodes=("/lab/_secret", "/_lab/plain", "/seen"),
    services=tuple(ServiceEndpoint(name, ADD, "", "/seen") for name in ("/a", "/a/_b", "/_c/d")),
    publishers=tuple(
        TopicEndpoint(name, "std_msgs/msg/String", "", "/seen", 1, True, False)
        for name in ("/t", "/t/_u", "/_v/w")
    ),
)


@pytest.mark.parametrize(
    ("listing", "option", "seen", "hidden"),
    [
        # As in ros2, a hidden namespace does not hide its nodes.
        (("node", "list"), "-a", ["/_lab/plain", "/seen"], ["/lab/_secret"]),
        (("node", "list"), "--all", ["/_lab/plain", "/seen"], ["/lab/_secret"]),
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


def test_a_hidden_node_has_no_info_without_the_option(run, monkeypatch):
    monkeypatch.setattr("taskrpc.cli.shared.graph.look", lambda remote: [HIDDEN])
    code, out, err = run("node", "info", "/lab/_secret")
    assert (code, out) == (1, "")
    assert err == (
        "Unable to find node '/lab/_secret'\n  hint: /lab/_secret is hidden; add --include-hidden\n"
    )
    assert run("node", "info", "/lab/_secret", "--include-hidden")[0] == 0
    assert run("node", "info", "/_lab/plain")[0] == 0


def test_empty_lists_print_nothing_and_count_0(run, monkeypatch):
    monkeypatch.setattr("taskrpc.cli.shared.graph.look", lambda remote: [])
    for kind in ("node", "service", "topic"):
        assert run(kind, "list") == (0, "", "")
        assert run(kind, "list", "-c") == (0, "0\n", "")
    assert run("topic", "list", "-v") == (0, "", "")
