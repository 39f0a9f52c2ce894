"""The calls of a recording as events: in the order of time, all counted, long lists thinned out."""

from __future__ import annotations

from taskrpc.observe.recording import call_events as module
from taskrpc.observe.recording.call_events import MAX_CALLS, call_events, graph_events
from taskrpc.observe.recording.calls import RecordedCall
from taskrpc.robot.tasks.page_events import MAX_NODES


def call(number, begin, ms=1.0, code="", client="/ada"):
    return RecordedCall("/add", number, begin, client, "", ms, code)


def shown(events):
    return [(each["id"], each["state"]) for event in events for each in event.data["calls"]]


def test_long_call_is_shown_when_it_begins_and_when_it_ends():
    events = list(call_events([call(1, 0.0, 2000.0), call(2, 1.0), call(3, 1.5, None)]))
    assert shown(events) == [(1, "open"), (2, "ok"), (3, "open"), (1, "ok")]
    assert [event.t for event in events] == sorted(event.t for event in events)
    assert events[-1].data["stats"]["open"] == 1
    assert events[-1].data["stats"]["total"] == 2


def test_statistics_count_every_call_although_few_are_listed():
    events = list(call_events([call(n, n / 10_000) for n in range(1000)]))
    listed = [len(event.data["calls"]) for event in events]
    assert max(listed) == MAX_CALLS
    assert sum(listed) + sum(event.data["skipped"] for event in events) == 1000
    assert events[-1].data["stats"]["total"] == 1000


def test_percentiles_are_of_the_newest_thousand_calls():
    slow = [call(n, n / 10, 500.0) for n in range(500)]
    calls = slow + [call(n, n / 10, float(n % 1000)) for n in range(500, 1500)]
    stats = list(call_events(calls))[-1].data["stats"]
    assert (stats["p50_ms"], stats["p99_ms"]) == (500.0, 990.0)


def test_very_long_list_is_thinned_out_but_its_few_errors_stay(monkeypatch):
    monkeypatch.setattr(module, "MOST_CALLS", 100)
    calls = [call(n, n / 10, code="BUSY" if n % 100 == 37 else "") for n in range(1000)]
    events = list(call_events(calls))
    states = [state for _, state in shown(events)]
    assert states.count("error") == 10
    assert 90 <= states.count("ok") <= 100
    assert sum(event.data["skipped"] for event in events) == 1000 - len(states)


def test_no_calls_give_no_events():
    assert list(call_events([])) == []


def test_nodes_are_bounded_and_shown_at_most_three_hundred_times():
    calls = [call(n, float(n), client=f"/client_{n}") for n in range(3000)]
    events = list(graph_events(0.0, 3000.0, None, calls))
    assert len(events) <= 302
    assert len(events[-1].data["nodes"]) == MAX_NODES
    assert events[-1].data["more"] == 900
