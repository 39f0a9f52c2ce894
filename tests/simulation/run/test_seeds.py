"""The seeds of a search: new ones, and variants of those whose runs were new."""

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.simulation.run.seeds import VARIANT, Seeds


@given(st.integers(0, 10**6), st.lists(st.integers(1, 7), max_size=20))
def test_without_news_the_seeds_count_up(first, sizes):
    seeds = Seeds(first, None)
    given_out = [each for size in sizes for each in seeds.take(size)]
    assert given_out == list(range(first, first + sum(sizes)))


@given(st.integers(0, 50), st.lists(st.integers(1, 9), min_size=60, max_size=60))
def test_count_is_the_number_of_seeds(count, sizes):
    seeds = Seeds(0, count)
    assert sum(len(seeds.take(size)) for size in sizes) == count
    assert seeds.take(1) == []


@given(st.lists(st.integers(0, 3), max_size=40))
def test_no_seed_is_given_twice(shapes):
    seeds, given_out = Seeds(0, None), []
    for shape in shapes:
        [seed] = seeds.take(1)
        given_out.append(seed)
        seeds.learn([(seed, shape)])
    assert len(set(given_out)) == len(given_out)
    assert seeds.found == len(set(shapes))


def test_variants_are_those_of_seeds_that_went_another_way():
    seeds = Seeds(0, None)
    seeds.learn([(7, 1), (8, 1), (9, 2)])
    variants = [each for each in seeds.take(40) if each >= VARIANT]
    assert variants == [7 + VARIANT, 9 + VARIANT]


def test_variant_that_goes_another_way_has_variants_too():
    seeds = Seeds(0, None)
    seeds.learn([(7 + VARIANT, 1)])
    assert 7 + 2 * VARIANT in seeds.take(4)


def test_single_run_has_the_seed_that_was_asked_for():
    assert Seeds(12, 1).take(200) == [12]
