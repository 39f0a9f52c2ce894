"""A join string survives what mails and people do to it, or says what was done to it."""

import re
import string

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.classroom.invitation import PREFIX, Invitation, from_join_string, to_join_string
from taskrpc.errors import TaskRpcError

LETTERS = string.ascii_letters + string.digits + "-_"
EXAMPLE = Invitation(
    ("192.168.1.20:7450",), bytes(range(32)), "ada.c2VjcmV0LXNlY3JldA", "/ada", 1_800_000_000, 7
)
invitations = st.builds(
    Invitation,
    st.lists(st.text(max_size=30), min_size=1, max_size=4).map(tuple),
    st.binary(min_size=32, max_size=32),
    st.text(max_size=40),
    st.text(max_size=20),
    st.integers(0, 2**40),
    st.integers(0, 232),
)


@given(invitations)
def test_what_a_string_says_is_what_it_was_made_of(invitation):
    text = to_join_string(invitation)
    assert from_join_string(text) == invitation
    assert re.fullmatch(r"taskrpc-join1\.[A-Za-z0-9_-]+", text)


@given(st.integers(min_value=0), st.sampled_from(["\n", " ", "\r\n", "\t"]))
def test_blanks_and_line_breaks_do_no_harm(place, blank):
    text = to_join_string(EXAMPLE)
    place %= len(text) + 1
    assert from_join_string(f" {text[:place]}{blank}{text[place:]}\n") == EXAMPLE


@settings(max_examples=30, deadline=None)
@given(st.integers(min_value=0), st.sampled_from(LETTERS))
def test_a_mistyped_character_is_told_with_its_place(place, other):
    text = to_join_string(EXAMPLE)
    # The last character has bits that mean nothing.
    place = len(PREFIX) + place % (len(text) - len(PREFIX) - 1)
    if text[place] == other:
        other = "A" if other != "A" else "B"
    wrong = text[:place] + other + text[place + 1 :]
    message = f"the join string is mistyped: the character at place {place + 1}, {other!r}"
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
        (PREFIX + "abc!def", "the join string has '!' at place 18, which none has"),
    ],
)
def test_what_is_no_join_string_is_told_in_a_sentence(text, message):
    with pytest.raises(TaskRpcError, match=re.escape(message)):
        from_join_string(text)


@settings(max_examples=50, deadline=None)
@given(st.text(LETTERS + ".\n é", max_size=8))
def test_whatever_is_pasted_raises_nothing_else(text):
    for pasted in (text, PREFIX + text):
        with pytest.raises(TaskRpcError):
            from_join_string(pasted)


def test_the_token_is_not_printed():
    assert "c2VjcmV0" not in repr(EXAMPLE)
