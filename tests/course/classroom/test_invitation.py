"""A join string survives changes by mail programs; for other changes, the error describes them."""

import base64
import binascii
import re
import string

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc.course.classroom.invitation import PREFIX, Invitation, from_join_string, to_join_string
from taskrpc.errors import TaskRpcError
from tests.properties import examples

LETTERS = string.ascii_letters + string.digits + "-_"
EXAMPLE = Invitation(
    ("192.168.1.20:7450",), bytes(range(32)), "ada.c2VjcmV0LXNlY3JldA", "/ada", 1_800_000_000, 7
)
PLACES = [
    "192.168.1.20:7450",
    "lab.example:1",
    "a-b.c:65535",
    "[::1]:80",
    "[fe80::1%eth0]:7450",
    "[fd00::1:2]:7",
]
invitations = st.builds(
    Invitation,
    st.lists(st.sampled_from(PLACES), min_size=1, max_size=4).map(tuple),
    st.binary(min_size=32, max_size=32),
    st.from_regex(r"[A-Za-z0-9_.@+-]{1,64}\.[A-Za-z0-9_~=+/-]{1,40}", fullmatch=True),
    st.from_regex(r"/([A-Za-z_][A-Za-z0-9_]{0,20})?", fullmatch=True),
    st.integers(0, 32_503_680_000),
    st.integers(0, 232),
)


@given(invitations)
def test_join_string_returns_the_values_that_it_was_made_of(invitation):
    text = to_join_string(invitation)
    assert from_join_string(text) == invitation
    assert re.fullmatch(r"taskrpc-join1\.[A-Za-z0-9_-]+", text)


@given(st.integers(min_value=0), st.sampled_from(["\n", " ", "\r\n", "\t"]))
def test_spaces_and_line_breaks_are_ignored(place, blank):
    text = to_join_string(EXAMPLE)
    place %= len(text) + 1
    assert from_join_string(f" {text[:place]}{blank}{text[place:]}\n") == EXAMPLE


@settings(max_examples=30)
@given(st.integers(min_value=0), st.sampled_from(LETTERS))
def test_mistyped_character_is_reported_with_its_position(place, other):
    text = to_join_string(EXAMPLE)
    # The last character has bits that mean nothing.
    place = len(PREFIX) + place % (len(text) - len(PREFIX) - 1)
    if text[place] == other:
        other = "A" if other != "A" else "B"
    wrong = text[:place] + other + text[place + 1 :]
    message = f"the join string is mistyped: the character at position {place + 1}, {other!r}"
    with pytest.raises(TaskRpcError, match=f"^{re.escape(message)}$"):
        from_join_string(wrong)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello", "expected a join string, which begins with taskrpc-join1., got 'hello'…"),
        ("", "expected a join string, which begins with taskrpc-join1., got ''…"),
        ("taskrpc-join2.abc", "got taskrpc-join2: another version"),
        (to_join_string(EXAMPLE)[:-9], "the join string is incomplete, or several characters"),
        (PREFIX, "the join string is incomplete"),
        (PREFIX + "abc!def", "the join string has '!' at position 18, which is never valid"),
    ],
)
def test_text_that_is_no_join_string_gives_one_sentence(text, message):
    with pytest.raises(TaskRpcError, match=re.escape(message)):
        from_join_string(text)


@settings(max_examples=examples(50))
@given(st.text(LETTERS + ".\n é", max_size=8))
def test_any_text_raises_no_other_error(text):
    for pasted in (text, PREFIX + text):
        with pytest.raises(TaskRpcError):
            from_join_string(pasted)


def test_the_token_is_not_printed():
    assert "c2VjcmV0" not in repr(EXAMPLE)


@pytest.mark.parametrize(
    "changes",
    [
        {"addresses": ()},
        {"addresses": ("evil\x1b]0;title\x07:1",)},
        {"addresses": ("unix:/tmp/evil",)},
        {"addresses": ("lab.example",)},
        {"addresses": ("lab.example:1\n",)},
        {"addresses": ("lab example:1",)},
        {"addresses": ("lab.example:1",) * 99},
        {"fingerprint": bytes(31)},
        {"token": "no account"},
        {"token": "ada\x1b[2J.secret"},
        {"token": ".secret"},
        {"token": "ada."},
        {"token": "ada.secret\n"},
        {"namespace": "ada"},
        {"namespace": "/ada/../root"},
        {"namespace": "/7"},
        {"namespace": "/ada\n"},
        {"namespace": ""},
        {"expires": -1},
        {"expires": 10**15},
        {"domain": 233},
    ],
)
def test_string_with_invalid_values_is_refused(changes):
    """A laptop prints, calls and stores its fields, and names its nodes after them."""
    wrong = to_join_string(replace(EXAMPLE, **changes))
    with pytest.raises(TaskRpcError, match="expected a join string of this version") as caught:
        from_join_string(wrong)
    assert str(caught.value).isprintable()


def test_a_string_that_nests_deeply_is_refused_or_read():
    body = bytearray(msgspec.msgpack.encode(EXAMPLE))
    body[0] += 1  # one value more, which this version does not know
    body += b"\x91" * 5_000 + b"\x01"
    text = base64.urlsafe_b64encode(binascii.crc32(body).to_bytes(4, "big") + body).decode()
    try:
        found = from_join_string(PREFIX + text.rstrip("="))
    except TaskRpcError as error:  # Python 3.13 reads so many levels
        found = error
    assert found == EXAMPLE or "expected a join string of this version" in str(found)


@pytest.mark.parametrize("length", [7000, 200_000])
def test_a_long_text_is_refused_without_a_search_for_its_mistake(length, monkeypatch):
    looks = []
    monkeypatch.setattr(binascii, "crc32", lambda body: looks.append(body) or 0)
    with pytest.raises(TaskRpcError):
        from_join_string(PREFIX + "A" * length)
    assert len(looks) <= 1
