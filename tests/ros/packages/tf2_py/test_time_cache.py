"""The history of one frame: order, age, interpolation. The cases are those of tf2's own tests."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.ros.packages.tf2_py.exceptions import ExtrapolationException
from taskrpc.ros.packages.tf2_py.geometry import Transform
from taskrpc.ros.packages.tf2_py.time_cache import Entry, StaticCache, TimeCache

SECOND = 1_000_000_000


def entry(time, parent="a", x=0.0):
    return Entry(time, parent, Transform((x, 0.0, 0.0)))


def filled(*entries, duration=10 * SECOND):
    cache = TimeCache(duration)
    for each in entries:
        cache.insert(each)
    return cache


def test_transforms_are_sorted_and_repeated_ones_are_kept_once():
    times = [0, 10, 5, 3, 8, 8, 8]
    given_entries = [entry(time, str(index)) for index, time in enumerate(times)]
    cache = filled(*given_entries, *reversed(given_entries), duration=10)
    assert (len(cache), cache.oldest_time, cache.latest_time) == (7, 0, 10)
    assert cache.at(8).parent == "6"  # the last of those with the same time
    assert cache.insert(entry(15, "7"))
    assert not cache.insert(entry(0, "8"))
    assert cache.insert(entry(5, "9"))
    assert (len(cache), cache.oldest_time) == (7, 5)


def test_time_0_asks_for_the_latest():
    cache = filled(*(entry(time, str(time)) for time in range(1, 100)))
    assert cache.at(0).parent == "99"
    assert cache.at(7).parent == "7"


def test_transform_between_two_others_is_interpolated():
    cache = filled(entry(200, x=1.0), entry(300, x=3.0))
    found = [cache.at(200 + step).transform.translation[0] for step in range(101)]
    assert found == pytest.approx([1 + 2 * step / 100 for step in range(101)])


def test_no_interpolation_between_different_parents():
    cache = filled(entry(200, "old", 1.0), entry(300, "new", 3.0))
    assert cache.at(299) == entry(200, "old", 1.0)
    assert cache.at(300) == entry(300, "new", 3.0)


@pytest.mark.parametrize(
    ("times", "asked", "text"),
    [
        ([2], 4, "at time 4.000000, but only time 2.000000 is in the buffer"),
        (
            [2, 3],
            4,
            "into the future.  Requested time 4.000000 but the latest data is at time 3.000000",
        ),
        (
            [2, 3],
            1,
            "into the past.  Requested time 1.000000 but the earliest data is at time 2.000000",
        ),
    ],
)
def test_a_time_outside_the_history_is_refused(times, asked, text):
    cache = filled(*(entry(time * SECOND) for time in times))
    with pytest.raises(ExtrapolationException) as caught:
        cache.at(asked * SECOND)
    assert str(caught.value) == f"Lookup would require extrapolation {text}"


def test_empty_history_has_no_transform():
    cache = filled(entry(5))
    cache.clear()
    assert (len(cache), cache.newest(), cache.latest_time, cache.oldest_time) == (0, None, 0, 0)
    with pytest.raises(ExtrapolationException):
        cache.at(0)


def test_static_transform_holds_at_all_times():
    cache = StaticCache()
    assert cache.newest() is None
    with pytest.raises(ExtrapolationException):
        cache.at(0)
    cache.insert(entry(5, x=1.0))
    cache.insert(entry(4, x=2.0))
    cache.clear()
    assert cache.at(77) == entry(77, x=2.0)
    assert (len(cache), cache.latest_time, cache.newest()) == (1, 0, entry(0, x=2.0))


@given(st.permutations([entry(time, x=time * 1.5) for time in (3, 7, 20, 21, 90)]))
def test_order_of_arrival_does_not_matter(entries):
    cache, in_order = filled(*entries), filled(*sorted(entries))
    assert [cache.at(time) for time in range(3, 91)] == [in_order.at(t) for t in range(3, 91)]
