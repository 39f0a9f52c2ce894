"""Liveliness tokens are those of rmw_zenoh; garbage is refused without an error."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.middleware.zenoh import tokens
from taskrpc.middleware.zenoh.tokens import Kind, Qos, Token
from tests.middleware.zenoh.test_keys import NAMES, TYPES

HASH = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
VECTOR = (
    "@ros2_lv/0/c0ffee/0/1/SS/%/%/taskrpc_server/%add_two_ints/"
    f"example_interfaces::srv::dds_::AddTwoInts_/{HASH}/::,10:,:,:,,"
)
SERVER = Token(
    kind=Kind.SERVER,
    domain=0,
    session="c0ffee",
    node_id=0,
    endpoint_id=1,
    node="/taskrpc_server",
    name="/add_two_ints",
    type_name="example_interfaces/srv/AddTwoInts",
    type_hash=HASH,
    qos=tokens.SERVICE_QOS,
)
QOS = st.builds(Qos, st.booleans(), st.booleans(), st.integers(1, tokens.MAX_DEPTH))
NUMBERS = st.integers(0, 2**31)
TOKENS = st.builds(
    Token,
    kind=st.sampled_from([kind for kind in Kind if kind is not Kind.NODE]),
    domain=st.integers(0, 232),
    session=st.from_regex("[0-9a-f]{1,32}", fullmatch=True),
    node_id=NUMBERS,
    endpoint_id=NUMBERS,
    node=NAMES,
    name=NAMES,
    type_name=TYPES,
    type_hash=st.just(HASH),
    qos=QOS,
    enclave=st.one_of(st.just(""), NAMES),
)


def test_the_token_of_a_service_is_that_of_rmw_zenoh():
    assert SERVER.key() == VECTOR
    assert tokens.parse(VECTOR) == SERVER


def test_the_token_of_a_node_has_its_namespace_and_its_number_twice():
    node = Token(Kind.NODE, 3, "ab", 5, 5, "/robot/arm/driver")
    assert node.key() == "@ros2_lv/3/ab/5/5/NN/%/%robot%arm/driver"
    assert tokens.parse(node.key()) == node


@given(TOKENS)
def test_tokens_survive_a_round_trip(token):
    assert tokens.parse(token.key()) == token


@given(TOKENS, st.lists(st.sampled_from(["cpu:", "cuda", "x=1"]), max_size=3))
def test_parts_that_newer_versions_add_are_ignored(token, more):
    assert tokens.parse("/".join([token.key(), *more])) == token


@given(TOKENS, st.integers(0, 200), st.text(max_size=5))
def test_damaged_tokens_are_no_error(token, place, junk):
    key = token.key()
    tokens.parse(key[:place] + junk + key[place + 1 :])


@given(st.text())
def test_garbage_is_no_error(text):
    tokens.parse(text)
    tokens.parse("@ros2_lv/" + text)
    tokens.qos_of(text)


@pytest.mark.parametrize(
    "key",
    [
        VECTOR.replace("SS", "XX"),
        VECTOR.replace("/0/c0ffee", "/zero/c0ffee"),
        VECTOR.replace("taskrpc_server", ""),
        VECTOR.replace("taskrpc_server", "a\x1b[31m"),
        VECTOR.rpartition("/")[0],
        VECTOR.replace("::,10:,:,:,,", ":"),
        VECTOR.replace("::,10", "x::,10"),
        VECTOR.replace("@ros2_lv", "@ros3_lv"),
        VECTOR.replace("/0/1/", "/0/-1/"),
    ],
)
def test_invalid_tokens_are_refused(key):
    assert tokens.parse(key) is None


@pytest.mark.parametrize(
    ("text", "qos"),
    [
        ("::,10:,:,:,,", Qos(depth=10)),
        ("::,:,:,:,,", Qos()),
        ("2::,1:,:,:,,", Qos(reliable=False, depth=1)),
        (":1:,5:,:,:,,", Qos(latched=True, depth=5)),
        ("1:2:1,7:,:,:,,", Qos(depth=7)),
        ("1:1:2,0:1,0:2,5:1,,", Qos(latched=True)),
        ("::,99999999999:,:,:,,", Qos(depth=tokens.MAX_DEPTH)),
        (":", None),
        ("a::,1", None),
    ],
)
def test_profiles_are_read(text, qos):
    assert tokens.qos_of(text) == qos


@given(QOS)
def test_profiles_survive_a_round_trip(qos):
    assert tokens.qos_of(tokens.text_of(qos)) == qos


def test_the_profile_of_services_is_that_of_rmw_zenoh():
    assert tokens.text_of(tokens.SERVICE_QOS) == "::,10:,:,:,,"
