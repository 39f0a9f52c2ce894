"""A tracked entry with changes applied equals an entry made from scratch."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.security import account_file
from taskrpc.core.security.lab import Lab
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.network import Address
from taskrpc.core.wire import handshake
from taskrpc.core.wire.messages import ServiceEndpoint

ABOUT = RegistryEntry(pid=1, script="a.py", folder="/", since=1.0)
NAMES = st.sampled_from(["a", "b", "c", "c2"])  # the last two are one name on two nodes


def endpoint(name):
    return ServiceEndpoint(f"/{name[0]}", "a/srv/B", "R", f"/n{name}")


@given(st.lists(st.tuples(st.sampled_from(["node", "client", "service"]), NAMES, st.booleans())))
def test_an_entry_contains_each_item_as_often_as_it_was_added_and_not_removed(steps):
    tracked = TrackedEntry(ABOUT)
    expected = {"node": Counter(), "client": Counter(), "service": Counter()}
    for kind, name, gone in steps:
        counts = expected[kind]
        if gone and not counts[name]:
            continue
        counts[name] += -1 if gone else 1
        item = name if kind == "node" else endpoint(name)
        tracked.apply(EntryChange(**{kind: item}, gone=gone))
    entry = tracked.entry()
    assert Counter(entry.nodes) == +expected["node"]
    assert Counter(entry.clients) == Counter(map(endpoint, expected["client"].elements()))
    assert Counter(entry.services) == Counter(map(endpoint, expected["service"].elements()))
    assert TrackedEntry(entry).entry() == entry
    for name in "abc":
        offered = any(name in one for one in (+expected["service"]))
        assert tracked.offers(f"/{name}") == entry.offers(f"/{name}") == offered


def test_an_entry_is_not_made_anew_while_nothing_changes():
    tracked = TrackedEntry(ABOUT)
    tracked.apply(EntryChange(node="/a"))
    assert tracked.entry() is tracked.entry()


def test_a_roster_learns_where_its_process_takes_calls():
    tracked = TrackedEntry(ABOUT)
    tracked.apply(EntryChange(address="127.0.0.1:7", token="ab", certificate="PEM"))
    tracked.apply(EntryChange(node="/a"))
    entry = tracked.entry()
    assert (entry.address, entry.token, entry.certificate) == ("127.0.0.1:7", "ab", "PEM")
    assert "ab" not in repr(entry)


def test_the_oldest_node_is_the_first_that_is_still_there():
    tracked = TrackedEntry(ABOUT)
    assert tracked.first_node == ""
    for node in ("/a", "/b"):
        tracked.apply(EntryChange(node=node))
    assert tracked.first_node == "/a"
    tracked.apply(EntryChange(node="/a", gone=True))
    assert tracked.first_node == "/b"


def test_no_repr_has_a_secret():
    secret = "canary"
    said = [
        RegistryEntry(1, "x.py", "/", 0.0, "host:1", secret),
        EntryChange(node="/n", address="host:1", token=secret),
        handshake._Key(secret.encode(), None),
        account_file.Row(secret),
        Lab(address="host:1", token=f"ada.{secret}", certificate="x"),
        Address("host:1", secret.encode()),
    ]
    assert not any(secret in repr(each) + str(each) + repr([each]) for each in said)
