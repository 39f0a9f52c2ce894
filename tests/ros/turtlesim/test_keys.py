"""The keys of turtle_teleop_key."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.ros.turtlesim.keys import DIRECTIONS, HEADINGS, KeyDecoder, windows_arrow


def decoded(data):
    decoder = KeyDecoder()
    return [key for byte in data if (key := decoder.feed(bytes([byte])))]


@pytest.mark.parametrize("introducer", [b"\x1b[", b"\x1bO"])
def test_arrow_keys_send_three_bytes(introducer):
    data = b"".join(introducer + last for last in (b"A", b"B", b"C", b"D"))
    assert decoded(data) == ["up", "down", "right", "left"]


def test_letters_are_keys_in_both_cases():
    assert decoded(b"gGq") == ["g", "g", "q"]


def test_unknown_sequences_press_nothing_and_the_next_key_works():
    assert decoded(b"\x1b[Zg") == ["g"]
    assert decoded(b"\x1b\x1b[A") == ["up"]


@given(st.binary(max_size=20))
def test_any_bytes_are_decoded_and_a_later_arrow_is_found(data):
    decoder = KeyDecoder()
    for byte in data:
        decoder.feed(bytes([byte]))
    assert [decoder.feed(one) for one in (b"\x1b", b"\x1b", b"[", b"A")][-1] == "up"


def test_windows_reports_arrows_as_special_keys():
    assert [windows_arrow(code) for code in "HPMKx"] == ["up", "down", "right", "left", ""]


def test_the_keys_around_f_turn_to_the_direction_in_which_they_lie():
    at = {"e": (-1, 1), "r": (0, 1), "t": (1, 1), "d": (-1, 0), "g": (1, 0)}
    at |= {"c": (-1, -1), "v": (0, -1), "b": (1, -1)}
    assert at.keys() == HEADINGS.keys()
    for key, (x, y) in at.items():
        assert math.cos(HEADINGS[key] - math.atan2(y, x)) == pytest.approx(1.0, abs=1e-6)
    assert set(DIRECTIONS) == {"up", "down", "left", "right"}
