"""What targets, values and times a rule concerns."""

import math

import pytest

from taskrpc.bridges.door import parse_policy
from taskrpc.bridges.door.policy import Range, Values, matches, overlaps, permits, shown


@pytest.mark.parametrize(
    ("pattern", "target", "concerned", "permitted"),
    [
        ("/a", "/a", True, True),
        ("/a", "/a/b", False, False),
        ("/a/*", "/a", False, False),
        ("/a/*", "/a/b", True, True),
        ("/a/*", "/a/b/c", True, True),
        ("/a/*", "/ab", False, False),
        ("/*", "/a/b", True, True),
        ("/a/*", "/a/_b", True, False),
        ("/a/*", "/a/b/_action/send_goal", True, False),
        ("/a/_b", "/a/_b", True, True),
        ("/a/*", "/a/set_parameters", True, False),
        ("/a/set_parameters", "/a/set_parameters", True, True),
    ],
)
def test_a_pattern_permits_no_hidden_names(pattern, target, concerned, permitted):
    assert matches(pattern, target) is concerned
    assert permits(pattern, target) is permitted


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("/a", "/a", True),
        ("/a", "/b", False),
        ("/a/*", "/a/b", True),
        ("/a/*", "/a/b/*", True),
        ("/a/*", "/b/*", False),
        ("/a", "/a/*", False),
        ("/*", "/a", True),
    ],
)
def test_two_patterns_overlap(one, other, expected):
    assert overlaps(one, other) is overlaps(other, one) is expected


RANGE = Range(-1, 2.5)


@pytest.mark.parametrize("value", [-1, 2.5, 0, -0.0, 1e-300])
def test_numbers_in_a_range_are_allowed(value):
    assert RANGE.allows(value)


@pytest.mark.parametrize(
    "value",
    [
        *(-1.0000001, 3, math.nan, math.inf, -math.inf, 10**400, -(10**400), True, False),
        *("1", b"1", None, [1], {}, 1j, object()),
    ],
)
def test_all_else_is_refused_by_a_range(value):
    assert not RANGE.allows(value)


@pytest.mark.parametrize("value", [math.nan, math.inf, True, None, "5"])
def test_a_range_without_an_end_refuses_what_is_no_finite_number(value):
    assert not Range(None, 5).allows(value)
    assert not Range(1, None).allows(value)


def test_a_range_without_an_end_allows_huge_integers():
    assert Range(1, None).allows(10**400)
    assert Range(None, 5).allows(-(10**400))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("dock", True),
        ("d\u043eck", False),  # a Cyrillic letter
        ("dock ", False),
        ("Dock", False),
        (b"dock", False),
        (1, True),
        (1.0, True),
        (True, False),
        ("1", False),
        (False, True),
        (0, False),
        (math.nan, False),
        (None, False),
        ([], False),
    ],
)
def test_a_list_of_values_allows_only_equal_values_of_the_same_kind(value, expected):
    assert Values(("dock", 1, False)).allows(value) is expected


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("d\u043eck\x1b[0m", r"'d\u043eck\x1b[0m'"),
        ("x" * 100, f"'{'x' * 60}...'"),
        (10**4000, "a far larger number"),
        (True, "true"),
        (math.nan, "nan"),
        (None, "a value of type NoneType"),
    ],
)
def test_a_value_is_shown_short_and_in_ascii(value, text):
    assert shown(value) == text


@pytest.mark.parametrize(
    ("window", "open_at", "closed_at"),
    [
        ("mon-fri 08:00..18:00", ["0 8:00", "4 17:59"], ["0 7:59", "0 18:00", "5 9:00", "6 9:00"]),
        ("08:00..18:00", ["0 8:00", "6 17:59"], ["6 18:00"]),
        ("sun 22:00..06:00", ["6 22:00", "6 23:59", "0 0:00", "0 5:59"], ["0 6:00", "6 5:00"]),
        ("sat-mon 10:00..24:00", ["5 10:00", "6 23:59", "0 12:00"], ["1 12:00", "1 0:00"]),
        ("wed 00:00..24:00", ["2 0:00", "2 23:59"], ["1 23:59", "3 0:00"]),
    ],
)
def test_a_window_has_its_minutes_and_no_others(window, open_at, closed_at):
    hours = parse_policy(f"a: {{when: {{/x: {window}}}}}").names["a"].when[0]

    def is_open(text):
        day, hour, minute = (int(each) for each in text.replace(":", " ").split())
        return hours.windows[0].has(day * 1440 + hour * 60 + minute)

    assert all(map(is_open, open_at))
    assert not any(map(is_open, closed_at))
