"""Callers take turns, whatever they do; each one's items come in order."""

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.execution.fair_queue import Turns

lanes = st.sampled_from("abc")
steps = st.lists(
    st.one_of(
        st.tuples(st.just("add"), lanes),
        st.tuples(st.sampled_from(["take", "surplus", "remove", "remove all"]), lanes),
    ),
    max_size=60,
)


def test_who_wants_little_waits_for_one_item_of_each_other():
    turns = Turns()
    for number in range(1000):
        turns.add("greedy", ("greedy", number))
    turns.add("modest", ("modest", 0))
    assert [turns.take() for _ in range(3)] == [("greedy", 0), ("modest", 0), ("greedy", 1)]


@given(steps)
def test_nothing_is_lost_or_overtaken_and_nobody_comes_twice_while_another_waits(steps):
    turns, waiting, number = Turns(), {"a": [], "b": [], "c": []}, 0
    passed_over = dict.fromkeys(waiting, frozenset())  # who came since a lane waits
    for what, lane in steps:
        count = turns.count
        assert count == sum(map(len, waiting.values()))
        if what == "add":
            number += 1
            if not waiting[lane]:
                passed_over[lane] = frozenset()
            turns.add(lane, (lane, number))
            waiting[lane].append((lane, number))
        elif what == "take" and count:
            item = turns.take()
            assert waiting[item[0]].pop(0) == item
            for other, items in waiting.items():
                if other != item[0] and items:
                    assert item[0] not in passed_over[other], "came twice before another"
                    passed_over[other] |= {item[0]}
            passed_over[item[0]] = frozenset()
        elif what == "surplus":
            item = turns.take_surplus(lane)
            longest = max(map(len, waiting.values()))
            if item is None:
                assert longest <= len(waiting[lane]) + 1
            else:
                assert len(waiting[item[0]]) == longest
                assert waiting[item[0]].pop() == item
        elif what == "remove" and waiting[lane]:
            item = waiting[lane].pop(number % len(waiting[lane]))
            turns.remove(lane, item)
        elif what == "remove all":
            unwanted = [item for item in waiting[lane] if item[1] % 2]
            assert turns.remove_all(lane, lambda item: item[1] % 2 == 1) == unwanted
            waiting[lane] = [item for item in waiting[lane] if not item[1] % 2]
    rest = [turns.take() for _ in range(turns.count)]
    assert sorted(rest) == sorted(item for items in waiting.values() for item in items)
