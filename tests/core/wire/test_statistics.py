"""Durations are counted in buckets, from which percentiles are at most 10 % off."""

from __future__ import annotations

import math
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.wire.messages import Resolved, encode
from taskrpc.core.wire.statistics import (
    BOUNDS,
    ServiceStatistics,
    Statistics,
    bucket_of,
    decode_statistics,
    percentile,
)
from taskrpc.errors import ProtocolError


@given(st.floats(min_value=2e-6, max_value=5e5))
def test_percentile_of_equal_durations_is_near_the_duration(seconds):
    for fraction in (0.5, 0.99):
        found = percentile({bucket_of(seconds): 7}, fraction)
        assert found == pytest.approx(seconds, rel=0.19)
    assert percentile({bucket_of(seconds): 1}, 0.5) == pytest.approx(seconds, rel=0.1)


@given(st.lists(st.floats(min_value=1e-6, max_value=100), min_size=1, max_size=300))
def test_percentile_is_near_that_of_the_sorted_durations(durations):
    durations.sort()
    buckets = Counter(map(bucket_of, durations))
    for fraction in (0.5, 0.99):
        exact = durations[max(0, math.ceil(fraction * len(durations)) - 1)]
        assert percentile(buckets, fraction) == pytest.approx(exact, rel=0.19)


@pytest.mark.parametrize("seconds", [-1.0, 0.0, 1e-6, 1.0, 1e9, math.inf])
def test_every_duration_has_a_bucket(seconds):
    assert 0 <= bucket_of(seconds) < len(BOUNDS)


def test_no_calls_have_no_percentile():
    assert percentile({}, 0.5) is None
    assert percentile({3: 0}, 0.5) is None


@given(
    st.dictionaries(st.integers(-(2**63), 2**63), st.integers(-5, 2**40)),
    st.sampled_from([0.5, 0.99]),
)
def test_counts_of_any_peer_give_a_percentile_or_none(durations, fraction):
    found = percentile({k: v for k, v in durations.items() if v >= 0}, fraction)
    assert found is None or found > 0


def test_statistics_keep_their_values_on_the_wire():
    service = ServiceStatistics("/add", 1, 2, {0: 3, 4: 1}, {10: 4})
    sent = Statistics(2.5, 1.0, 0.1, 3, [service], {"/ada": 4})
    assert decode_statistics(encode(sent)) == sent


def test_another_message_is_no_statistics():
    with pytest.raises(ProtocolError, match="Statistics is not valid"):
        decode_statistics(encode(Resolved(1, 0, "", "", "", b"")))
