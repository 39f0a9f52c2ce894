"""The fair queue serves the flows in turn and keeps the order of each flow."""

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.execution.fair_queue import FairQueue

flows = st.sampled_from("abc")
steps = st.lists(
    st.one_of(
        st.tuples(st.just("add"), flows),
        st.tuples(st.sampled_from(["take", "surplus", "remove", "remove all"]), flows),
    ),
    max_size=60,
)


def test_small_flow_waits_for_one_item_of_each_other_flow():
    queue = FairQueue()
    for number in range(1000):
        queue.add("greedy", ("greedy", number))
    queue.add("modest", ("modest", 0))
    assert [queue.take() for _ in range(3)] == [("greedy", 0), ("modest", 0), ("greedy", 1)]


@given(steps)
def test_no_item_is_lost_or_overtaken_and_no_flow_is_served_twice_while_another_waits(steps):
    queue, waiting, number = FairQueue(), {"a": [], "b": [], "c": []}, 0
    passed_over = dict.fromkeys(waiting, frozenset())  # flows served since this flow waits
    for what, flow in steps:
        count = queue.count
        assert count == sum(map(len, waiting.values()))
        if what == "add":
            number += 1
            if not waiting[flow]:
                passed_over[flow] = frozenset()
            queue.add(flow, (flow, number))
            waiting[flow].append((flow, number))
        elif what == "take" and count:
            item = queue.take()
            assert waiting[item[0]].pop(0) == item
            for other, items in waiting.items():
                if other != item[0] and items:
                    assert item[0] not in passed_over[other], "was served twice before another"
                    passed_over[other] |= {item[0]}
            passed_over[item[0]] = frozenset()
        elif what == "surplus":
            item = queue.take_surplus(flow)
            longest = max(map(len, waiting.values()))
            if item is None:
                assert longest <= len(waiting[flow]) + 1
            else:
                assert len(waiting[item[0]]) == longest
                assert waiting[item[0]].pop() == item
        elif what == "remove" and waiting[flow]:
            item = waiting[flow].pop(number % len(waiting[flow]))
            queue.remove(flow, item)
        elif what == "remove all":
            unwanted = [item for item in waiting[flow] if item[1] % 2]
            assert queue.remove_all(flow, lambda item: item[1] % 2 == 1) == unwanted
            waiting[flow] = [item for item in waiting[flow] if not item[1] % 2]
    rest = [queue.take() for _ in range(queue.count)]
    assert sorted(rest) == sorted(item for items in waiting.values() for item in items)
