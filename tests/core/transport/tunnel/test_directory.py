"""The directory of programs believes only what is well-formed."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.transport.tunnel.directory import Directory, presence_of
from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint
from taskrpc.errors import ProtocolError

ADD = ServiceEndpoint("/add", "a/srv/Add", "RIHS01_1", "/server")
TOPIC = TopicEndpoint("/t", "a/msg/T", "RIHS01_2", "/server", 10, True, False)


def entry(**more):
    about = {"pid": 17, "script": "server.py", "folder": "/home/ana", "since": 5.0}
    return RegistryEntry(**(about | {"address": "x", "token": "736563726574"} | more))


def seen(**more):
    directory = Directory()
    directory.seen("box 1", presence_of(entry(**more), b"public", 1))
    return directory


def test_a_program_is_found_by_what_it_offers_and_publishes():
    directory = seen(nodes=("/server",), services=(ADD,), publishers=(TOPIC,))
    (found,) = directory.serving("/add")
    assert (found.about.address, found.services["/add"]) == ("box 1", ADD)
    assert list(directory.serving("/other")) == []
    ((found, topics),) = directory.publishing(["/t", "/u"])
    assert topics == ["/t"]
    assert [each.nodes for each in directory.entries()] == [("/server",)]
    assert "box 1" in directory
    assert "box 2" not in directory


def test_a_later_presence_replaces_the_earlier_one():
    directory = seen(services=(ADD,))
    directory.seen("box 1", presence_of(entry(services=()), b"", 2))
    assert list(directory.serving("/add")) == []


def test_an_old_presence_that_arrives_late_is_ignored():
    directory, empty = seen(services=(ADD,)), entry(services=())
    directory.seen("box 1", presence_of(empty, b"", 0))
    assert list(directory.serving("/add"))
    directory.gone("box 1")
    directory.seen("box 1", presence_of(empty, b"", 0))
    assert not list(directory.serving("/add"))


def test_a_program_that_started_again_at_the_same_place_replaces_the_earlier_one():
    directory = seen(services=(ADD,))
    directory.seen("box 1", presence_of(entry(services=(), since=6.0), b"", 0))
    assert not list(directory.serving("/add"))


def test_a_program_that_is_gone_is_forgotten():
    directory = seen(services=(ADD,))
    assert directory.gone("box 1")
    assert not directory.gone("box 1")
    assert list(directory.serving("/add")) == []


def test_a_program_that_accepts_no_calls_is_only_shown():
    directory = seen(address="", services=(ADD,), publishers=(TOPIC,))
    assert list(directory.serving("/add")) == []
    assert list(directory.publishing(["/t"])) == []
    assert len(directory.entries()) == 1


def test_only_the_given_token_and_nothing_of_the_machine_is_shown():
    (found,) = seen().entries()
    assert (found.pid, found.folder, found.certificate) == (0, "", "")
    assert bytes.fromhex(found.token) == b"public"


@pytest.mark.parametrize("text", ["\x1b[2J", "a\nb", "x" * 5000])
def test_control_characters_and_long_names_of_a_script_are_not_sent(text):
    (found,) = seen(script=text).entries()
    assert found.script.isprintable()
    assert len(found.script) <= 200


@pytest.mark.parametrize("field", range(5))
def test_a_presence_with_control_characters_is_refused(field):
    evil = "/x\x1b[2J"
    service, topic = (
        msgspec.structs.replace(ADD, name=evil),
        msgspec.structs.replace(TOPIC, name=evil),
    )
    names = ("nodes", "services", "clients", "publishers", "subscriptions")
    values = ((evil,), (service,), (service,), (topic,), (topic,))
    directory = Directory()
    with pytest.raises(ProtocolError):
        directory.seen("box 1", presence_of(entry(**{names[field]: values[field]}), b"", 1))
    assert directory.entries() == []


@given(st.one_of(st.binary(max_size=200), st.data()))
def test_any_other_bytes_raise_only_a_protocol_error(given_data):
    directory = Directory()
    if not isinstance(given_data, bytes):
        good = bytearray(presence_of(entry(services=(ADD,), publishers=(TOPIC,)), b"public", 1))
        position = given_data.draw(st.integers(0, len(good) - 1))
        good[position] = given_data.draw(st.integers(0, 255))
        given_data = bytes(good)[: given_data.draw(st.integers(0, len(good)))]
    try:
        directory.seen("box 1", given_data)
    except ProtocolError:
        assert directory.entries() == []
    else:
        (found,) = directory.entries()
        bytes.fromhex(found.token)


def test_a_later_version_may_append_fields():
    shown = msgspec.msgpack.decode(presence_of(entry(services=(ADD,)), b"", 1))
    directory = Directory()
    directory.seen("box 1", msgspec.msgpack.encode([*shown, "new"]))
    assert len(list(directory.serving("/add"))) == 1
