"""A sum tree agrees with a sorted list after every insertion and removal."""

import itertools

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from taskrpc.robot.tasks.queue import sum_tree
from taskrpc.robot.tasks.queue.sum_tree import SumTree
from tests.properties import examples

STEPS = st.lists(
    st.tuples(st.sampled_from("iiirw"), st.integers(0, 200), st.integers(0, 1000)), max_size=400
)


def check(tree, model, number):
    items = sorted(model.items())
    values = [f"v{key}" for key, _ in items]
    assert list(tree.behind(-1)) == values
    assert list(tree.behind(number)) == [f"v{key}" for key, _ in items if key > number]
    assert bool(tree) == bool(model)
    assert tree.weight == sum(model.values())
    assert tree.weight_through(number) == sum(w for key, w in items if key <= number)
    assert tree.before(number) == max(
        (f"v{key}" for key, _ in items if key < number), key=lambda v: int(v[1:]), default=None
    )
    if model:
        assert tree.last() == values[-1]
    for key, _ in items:
        assert tree.before(key + 1) == f"v{key}"


@settings(max_examples=examples(60))
@given(steps=STEPS)
def test_it_agrees_with_a_sorted_list(steps):
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(sum_tree, "_WIDTH", 4)
        tree, model = SumTree(), {}
        for count, (what, number, weight) in enumerate(steps):
            if what == "i" and number not in model:
                tree.insert(number, f"v{number}", weight)
                model[number] = weight
            elif what == "r" and number in model:
                assert tree.remove(number) == f"v{number}"
                del model[number]
            elif what == "w" and number in model:
                tree.weigh(number, weight)
                model[number] = weight
            if count % 20 == 0:
                check(tree, model, number)
        check(tree, model, 100)
        for number in list(model):
            tree.remove(number)
            del model[number]
        check(tree, {}, 100)


def test_missing_number_raises_key_error():
    tree = SumTree()
    for number in (1, 3):
        tree.insert(number, number, 1.0)
    for question in (tree.remove, lambda number: tree.weigh(number, 2.0)):
        for number in (0, 2, 4):
            with pytest.raises(KeyError):
                question(number)


def test_a_queue_that_moves_on_for_ever_stays_low():
    """Values enter behind and leave in front; no empty or forgotten part stays."""
    tree = SumTree()
    for number in range(20_000):
        tree.insert(number, number, 0.1)
        if number >= 300:
            tree.remove(number - 300)
    assert tree.weight == pytest.approx(30.0)
    assert _depth(tree._root) <= 3
    assert _nodes(tree._root) < 20


def test_sums_keep_no_rounding_errors_of_removed_values():
    tree = SumTree()
    tree.insert(0, "small", 0.1)
    for number in itertools.chain(range(1, 1000), range(2000, 2001)):
        tree.insert(number, "large", 1e15)
    for number in itertools.chain(range(1, 1000), range(2000, 2001)):
        tree.remove(number)
    assert tree.weight == 0.1


def _depth(node):
    return 1 if node.is_leaf else 1 + _depth(node.parts[0])


def _nodes(node):
    return 1 if node.is_leaf else 1 + sum(map(_nodes, node.parts))
