"""The benchmark harness measures real processes correctly and in little time."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.contenders import BASELINE, CONTENDERS, contender, raw_asyncio
from benchmarks.harness import idle, machine, plot
from benchmarks.harness.benchmark import Settings, expected_minutes, published, run, write
from benchmarks.harness.goals import Goal
from benchmarks.harness.jsonfile import from_json, to_json
from benchmarks.harness.processes import CAN_PIN, ChildFailed, Pair
from benchmarks.harness.quantiles import quantile
from benchmarks.harness.report import report
from benchmarks.harness.results import Idle, Results, figure
from benchmarks.harness.sources import sources_digest
from benchmarks.harness.workloads import phases
from benchmarks.run import HOME as PUBLISHED

ABOUT = {
    "date": "2026-01-01",
    "cpu": "a processor",
    "cores": 2,
    "system": "a system",
    "python": "CPython 3",
    "commit": "",
    "rounds": 1,
    "seconds": 1,
    "quick": True,
}
TINY = Settings(
    rounds=1, seconds=0.01, idle_counts=(0, 30), idle_rounds=1, idle_seconds=0.01, quick=True
)


@pytest.mark.end_to_end
@pytest.mark.real_time
def test_small_benchmark_writes_tables_numbers_and_a_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(idle, "_SETTLING", 0.01)
    results = run([BASELINE, contender("taskrpc")], TINY)
    write(results, tmp_path)

    assert results.left_out == {}
    report = (tmp_path / "RESULTS.md").read_text(encoding="utf-8")
    for heading in ("Goals", "Payloads", "Idle connections", "Start-up", "Method", "Versions"):
        assert f"## {heading}" in report
    assert str(tmp_path) not in report
    numbers = (tmp_path / f"results-{results.python}.json").read_text(encoding="utf-8")
    found = json.loads(numbers)
    calls = found["calls"][f"{'pinned' if CAN_PIN else 'free'}, AddTwoInts, 64 in flight"]
    assert calls["raw asyncio"]["rate"]["ratios"] == [1.0]
    assert calls["taskrpc"]["rate"]["values"][0] > 100
    assert set(found["idle_connections"]["taskrpc"]) == {"0", "30"}
    assert found["start_up"]["taskrpc"][0] > 0.01
    ElementTree.fromstring((tmp_path / "latency.svg").read_text(encoding="utf-8"))
    assert found["about"]["sources"] == sources_digest()
    again = json.loads(to_json(from_json(numbers)))
    for section in found.keys() - {"goals"}:  # these are computed from rounded numbers now
        assert again[section] == found[section]


def test_table_of_goals_has_columns_for_each_python_from_the_oldest_on(tmp_path):
    for python in ("3.12.1", "3.9.2"):
        run = Results({**ABOUT, "python": f"CPython {python}"})
        ours = 0.1 if python == "3.9.2" else 0.25
        run.start_up = {"raw asyncio": [0.1], "taskrpc": [ours]}
        (tmp_path / f"results-{run.python}.json").write_text(to_json(run))
    text = report(published(tmp_path))
    assert "| goal | asyncio, 3.9 | asyncio, 3.12 | goal | uvloop, 3.9 | uvloop, 3.12 |" in text
    assert (
        "| start of a server to its first answer | ≤ 1.5 | 1.00, met | 2.50, **not met** |" in text
    )
    assert "Python 3.9 meets 1 on asyncio's loop and 0 on uvloop" in text
    assert "Python 3.12 meets 0 on asyncio's loop and 0 on uvloop" in text


def test_published_tables_are_those_that_the_tool_writes_from_the_numbers():
    written = (PUBLISHED / "RESULTS.md").read_text(encoding="utf-8")
    assert written == report(published(PUBLISHED)), "python benchmarks/run.py --tables"


def test_published_figures_are_of_the_present_wire_and_transport():
    current = sources_digest()
    old = [run.python for run in published(PUBLISHED) if run.about.get("sources") != current]
    assert not old, f"measure these Pythons again with `make bench PYTHON=…`: {', '.join(old)}"


def test_longer_measurements_and_more_rounds_are_expected_to_take_longer():
    short, long = Settings(rounds=2, seconds=0.1), Settings(rounds=4, seconds=0.2)
    assert expected_minutes(CONTENDERS, short) < expected_minutes(CONTENDERS, long) / 2
    assert expected_minutes(CONTENDERS[:3], long) < expected_minutes(CONTENDERS, long) / 2


@pytest.mark.real_time
def test_dead_server_is_reported_and_does_not_hang():
    with Pair(BASELINE) as pair:
        pair.start()
        assert pair.server is not None
        os.kill(pair.server.pid, signal.SIGTERM)
        with pytest.raises(ChildFailed, match="raw asyncio, server: ended with code"):
            pair.usage()


def test_ratios_are_taken_within_each_round():
    found = figure([10.0, 40.0, 30.0], [10.0, 20.0, 10.0])
    assert (found.value, found.ratio, found.low, found.high) == (30.0, 2.0, 1.0, 3.0)


def test_zero_from_a_coarse_clock_gives_no_figure():
    """On Windows the clock of CPU time ticks every 16 ms."""
    sample = {"elapsed": 1.0, "p50": 1.0, "p99": 1.0, "calls": 10, "cpu": 0.1}
    results = Results({**ABOUT})
    workload = next(iter(phases(can_pin=False)))[0]
    for name in ("raw asyncio", "taskrpc"):
        results.add(workload, name, sample, {**sample, "cpu": 0.0})
    assert results.figure(workload, "taskrpc", "cpu") is None
    assert results.figure(workload, "taskrpc", "rate").ratio == 1.0
    rounds = json.loads(to_json(results))["calls"][workload.key]["taskrpc"]
    assert (rounds["cpu"]["ratios"], rounds["rate"]["ratios"]) == ([None], [1.0])


@given(st.lists(st.floats(1e-6, 10), min_size=1), st.floats(0.001, 1))
def test_quantile_is_the_least_value_that_the_share_does_not_exceed(values, share):
    found = quantile(values, share)
    assert found in values
    assert sum(value <= found for value in values) >= share * len(values)
    assert sum(value < found for value in values) < share * len(values)


def test_goal_is_met_at_its_limit_and_not_beyond():
    at_most = Goal("p50", (0.5, 0.4), lambda results, loop: None)
    at_least = Goal("calls/s", (2.0, 3.0), lambda results, loop: None, at_most=False)
    assert [at_most.is_met(0.5, 0), at_most.is_met(0.5, 1)] == [True, False]
    assert [at_least.is_met(2.0, 0), at_least.is_met(2.0, 1)] == [True, False]


def test_unmeasured_goal_is_marked():
    assert "| p50, plain callback | ≤ 0.62 | not measured |" in report([Results(ABOUT)])


def test_report_says_that_the_machine_was_busy():
    told = "Load average at the start: 0.2; during the run others used 0.05 cores."
    warning = "The machine was busy"
    quiet = report([Results({**ABOUT, "load": 0.2, "others": 0.05})])
    assert told in quiet
    assert warning not in quiet
    assert warning in report([Results({**ABOUT, "load": 3.5, "others": None})])
    assert warning in report([Results({**ABOUT, "load": 0.2, "others": 0.9})])


def test_load_of_other_programs_is_counted_in_cores(monkeypatch):
    seconds = iter([(100.0, 50.0), (110.0, 52.5)])
    now = None

    def busy():
        nonlocal now
        now, found = next(seconds)
        return found

    monkeypatch.setattr(machine, "_busy_beside_us", busy)
    monkeypatch.setattr(machine.time, "monotonic", lambda: now or 100.0)
    assert machine.Others().cores() == 0.25


def test_waiting_for_disks_is_not_counted_as_busy():
    assert machine._busy("cpu  100 20 30 9000 900 4 5 6 7 8\ncpu0 1 1 1", 100) == 1.65


def test_report_lists_the_imports_of_a_command():
    found = {"taskrpc --help": {"taskrpc": (4, 0.002)}, "taskrpc-call /add": {}}
    assert "| taskrpc | 4 modules, 2.00 ms | none |" in report([Results(ABOUT, imports=found)])


def test_memory_of_idle_connections_is_the_difference():
    held = {0: Idle([5e6]), 100: Idle([5.2e6])}
    results = Results({}, idle={"taskrpc": held})
    assert results.idle_bytes("taskrpc", 100) == pytest.approx(2000)
    assert results.idle_bytes("taskrpc", 0) is None
    assert results.idle_bytes("taskrpc", 200) is None


def test_contenders_have_unique_names_and_existing_modules():
    names = [each.name for each in CONTENDERS]
    assert len(set(names)) == len(names)
    for each in CONTENDERS:
        assert importlib.util.find_spec(f"benchmarks.contenders.{each.module}")


def test_missing_library_is_named():
    assert contender("taskrpc").missing() == []
    absent = type(BASELINE)("x", "x", needs=("no_such_library",), programs=("no-such-program",))
    assert absent.missing() == ["no_such_library", "no-such-program"]


def test_bars_reach_from_the_baseline_to_the_ratio():
    panels = [plot.Panel("latency", "less is better")]
    rows = [plot.Row("half", (0.5,)), plot.Row("double", (2.0,)), plot.Row("unknown", (None,))]
    drawn = ElementTree.fromstring(plot.bars("title", panels, rows, "a < b"))
    bars = [each for each in drawn.iter() if each.get("class") == "peer"]
    left, right = ((float(bar.get("x")), float(bar.get("width"))) for bar in bars)
    assert left[0] + left[1] == pytest.approx(right[0], abs=0.2)
    assert left[1] == pytest.approx(right[1], abs=0.2)


class _Written(list):
    """A transport that keeps each write."""

    def write(self, data):
        self.append(data)


@given(st.lists(st.binary(max_size=20)), st.data())
def test_baseline_answers_all_frames_of_a_read_with_one_write(bodies, data):
    sent = b"".join(map(raw_asyncio.frame, bodies))
    server, written = raw_asyncio.Server(), _Written()
    server.connection_made(written)
    reads = 0
    while sent:
        size = data.draw(st.integers(1, len(sent)))
        server.data_received(sent[:size])
        reads, sent = reads + 1, sent[size:]
    assert b"".join(written) == b"".join(map(raw_asyncio.frame, bodies))
    assert len(written) <= reads


def test_baseline_joins_the_chunks_of_a_large_frame_once():
    server, written = raw_asyncio.Server(), _Written()
    server.connection_made(written)
    large = raw_asyncio.frame(bytes(100_000))
    for start in range(0, len(large), 1000):
        assert len(server._chunks) == start // 1000
        server.data_received(large[start : start + 1000])
    assert written == [large]
    assert server._chunks == []
