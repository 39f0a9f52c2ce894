"""The decisions of a run follow from its seed, each by itself."""

from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.simulation.run.choices import Choices
from taskrpc.simulation.run.seeds import VARIANT

SEEDS = st.integers(0, 10 * VARIANT)
NAMES = st.text(max_size=20)


class Ready(NamedTuple):
    ident: int


@given(SEEDS, NAMES, st.floats(0, 1))
def test_same_seed_and_name_give_the_same_decision(seed, name, share):
    one, other = Choices(seed), Choices(seed)
    other.fraction("something else first")
    assert one.happens(name, share) == other.happens(name, share)
    assert one.fraction(name) == other.fraction(name)
    assert one.chance(name).random() == other.chance(name).random()


@given(SEEDS, NAMES)
def test_fraction_is_below_one(seed, name):
    assert 0 <= Choices(seed).fraction(name) < 1


@given(SEEDS, NAMES, st.floats(0, 100), st.floats(0, 100))
def test_seconds_lie_in_their_range(seed, name, one, other):
    least, most = sorted((one, other))
    assert least <= Choices(seed).seconds(name, least, most) <= most * (1 + 1e-12)


@given(SEEDS, NAMES)
def test_share_of_nothing_never_happens_and_of_all_always(seed, name):
    assert not Choices(seed).happens(name, 0.0)
    assert Choices(seed).happens(name, 1.0)


@given(SEEDS, st.sets(NAMES, max_size=5), NAMES, st.floats(0, 1))
def test_fault_left_out_changes_no_other_fault(seed, kept, name, share):
    happens = Choices(seed, kept).happens(name, share)
    assert happens == (name in kept and Choices(seed).happens(name, share))


@given(st.integers(0, VARIANT - 1), st.integers(1, 9), NAMES)
def test_variant_of_a_seed_keeps_the_faults(seed, variant, name):
    assert Choices(seed).fraction(name) == Choices(seed + variant * VARIANT).fraction(name)


def orders(seed, turns=40):
    choices = Choices(seed)
    return [choices.next([Ready(1), Ready(2), Ready(3)]) for _ in range(turns)]


@given(SEEDS)
def test_same_seed_gives_the_same_order_of_threads(seed):
    assert orders(seed) == orders(seed)
    assert set(orders(seed)) <= {0, 1, 2}


def test_variants_of_a_seed_have_other_orders():
    assert len({tuple(orders(5 + number * VARIANT)) for number in range(20)}) > 15


def test_half_of_the_seeds_let_one_thread_run_for_long():
    longest = [max(map(orders(seed).count, range(3))) for seed in range(100)]
    assert 30 < sum(each > 25 for each in longest) < 70


@given(SEEDS)
def test_orderly_choices_take_the_first_that_was_ready(seed):
    choices = Choices(seed, orderly=True)
    assert [choices.next([Ready(3), Ready(1)]) for _ in range(20)] == [0] * 20
