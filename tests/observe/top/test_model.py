"""Rates, percentiles and errors come from the difference of two readings."""

from __future__ import annotations

import math

import pytest

from taskrpc.core.transport.base import ProgramStatistics
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.core.wire.statistics import ServiceStatistics, Statistics, bucket_of
from taskrpc.errors import Code
from taskrpc.observe.top.model import History, Pose, TaskRow, TaskServerRow


def entry(pid=1, *, nodes=("/server",), services=("/add",), address="here:1"):
    named = tuple(ServiceEndpoint(name, "a/srv/B", "h", nodes[0]) for name in services)
    return RegistryEntry(pid, f"p{pid}.py", "/", 0.0, address, nodes=nodes, services=named)


def reading(clock, calls=0, *, of=None, since=0.0, cpu=0.0, callers=None, **counts):
    """A reading of a program whose calls of /add took 1 ms each, but for the given counts."""
    codes = {int(Code.OK): calls} | counts.pop("codes", {})
    durations = counts.pop("durations", {bucket_of(0.001): calls})
    load = counts.pop("running", 0), counts.pop("waiting", 0)
    service = ServiceStatistics(counts.pop("name", "/add"), *load, codes, durations)
    assert not counts
    found = Statistics(clock, since, cpu, 0, [service], callers or {})
    return ProgramStatistics(of or entry(), found)


def view_after(*readings, hidden=False):
    history = History(hidden=hidden)
    for each in readings:
        history.add(each if isinstance(each, list) else [each])
    return history.view(0.0)


def test_one_reading_gives_no_rate():
    view = view_after(reading(10, 5))
    (row,) = view.services
    assert (row.per_second, row.p50, row.errors, view.seconds) == (None, None, 0, 0)
    assert view.nodes[0].calls_in is None
    assert view.nodes[0].calls_out is None
    assert view.per_second is None


def test_rate_is_the_difference_of_two_readings():
    (row,) = view_after(reading(10, 5), reading(12, 25)).services
    assert row.per_second == 10
    assert row.p50 == pytest.approx(0.001, rel=0.1)
    assert row.codes == {0: 20}


@pytest.mark.parametrize("clock", [-1.0, 0.0, math.nan, math.inf])
def test_a_clock_that_does_not_advance_gives_no_rate(clock):
    (row,) = view_after(reading(0, 5), reading(clock, 25)).services
    assert row.per_second is None


def test_rates_are_those_of_the_last_five_seconds():
    history = History()
    for second in range(20):
        history.add([reading(second, 100 if second >= 3 else 0)])
    view = history.view(0.0)
    assert (view.seconds, view.services[0].per_second, view.services[0].p99) == (5, 0, None)
    assert view.services[0].codes == {0: 100}


def test_rare_readings_are_compared_with_the_one_before():
    view = view_after(reading(0, 0), reading(30, 0), reading(60, 60))
    assert (view.seconds, view.services[0].per_second) == (30, 2)


def test_errors_count_from_the_start_and_within_the_window():
    history = History()
    failed = {int(Code.NOT_FOUND): 3, int(Code.CANCELLED): 5}
    history.add([reading(0, codes={int(Code.NOT_FOUND): 1})])
    history.add([reading(1, codes=failed)])
    view = history.view(0.0)
    assert (view.services[0].errors, view.services[0].errors_now) == (2, 2)
    for second in range(2, 9):
        history.add([reading(second, codes=failed)])
    view = history.view(0.0)
    assert (view.errors, view.errors_now) == (2, 0)


def test_counts_that_begin_anew_are_not_compared_with_the_old_ones():
    view = view_after(reading(10, 500), reading(20, 3, since=15.0))
    assert (view.services[0].per_second, view.services[0].codes) == (None, {})


def test_servers_of_one_service_are_added_up():
    one, two = entry(1, nodes=("/one",)), entry(2, nodes=("/two",), address="here:2")
    view = view_after(
        [reading(0, 0, of=one), reading(100, 0, of=two)],
        [reading(1, 10, of=one, running=1), reading(101, 30, of=two, waiting=2)],
    )
    (row,) = view.services
    assert (row.per_second, row.running, row.waiting, row.nodes) == (40, 1, 2, ("/one", "/two"))
    assert [(node.name, node.calls_in) for node in view.nodes] == [("/one", 10), ("/two", 30)]
    assert (view.open, view.programs) == (3, 2)


def test_a_node_shows_the_calls_that_it_makes_to_all_programs():
    ada = ProgramStatistics(entry(9, nodes=("/ada",), services=(), address=""), None)
    view = view_after(
        [reading(0), ada],
        [reading(2, 8, callers={"/ada": 6, "/ben": 2}, cpu=0.5), ada],
    )
    rows = {row.name: row for row in view.nodes}
    assert (rows["/ada"].calls_out, rows["/ada"].calls_in, rows["/ada"].cpu) == (3, None, None)
    assert (rows["/server"].calls_out, rows["/server"].cpu) == (0, 0.25)


def test_a_program_that_does_not_answer_shows_no_old_figures():
    silent = ProgramStatistics(entry(), None, "it did not respond in time")
    view = view_after(reading(0), reading(1, 10), silent)
    (row,) = view.nodes
    assert (row.calls_in, row.cpu, row.problem) == (None, None, "it did not respond in time")
    assert view.services == ()
    (row,) = view_after(reading(0), reading(1, 10), silent, reading(2, 30)).nodes
    assert (row.calls_in, row.problem) == (15, "")


def test_a_program_that_never_answered_has_a_row():
    unknown = RegistryEntry(0, "10.0.0.1:7450", "", 0.0, "10.0.0.1:7450")
    (row,) = view_after(ProgramStatistics(unknown, None, "Connection refused")).nodes
    assert (row.name, row.problem) == ("10.0.0.1:7450", "Connection refused")


def test_nodes_whose_services_were_called_stand_before_other_nodes():
    server = entry(1, nodes=("/task_server",))
    clients = entry(2, nodes=("/ada", "/bob"), services=(), address="")
    other = ProgramStatistics(clients, None)
    view = view_after(*([reading(second, calls, of=server), other] for second, calls in CALLED))
    assert [row.name for row in view.nodes] == ["/task_server", "/ada", "/bob"]


CALLED = [(0, 0), (1, 5), *((second, 5) for second in range(2, 20))]
"""Seconds and calls: five calls, which are older than the window at the end."""


def test_nodes_with_a_problem_stand_first():
    silent = ProgramStatistics(entry(2, nodes=("/z",), address="b:2"), None, "silent")
    assert [row.name for row in view_after([reading(0), silent]).nodes] == ["/z", "/server"]


def test_services_that_were_called_stand_first_and_stay_there():
    offered = entry(services=("/a", "/b"))

    def both(clock, calls):
        services = [ServiceStatistics("/a", 0, 0), ServiceStatistics("/b", 0, 0, {0: calls})]
        return [ProgramStatistics(offered, Statistics(clock, 0.0, 0.0, 0, services))]

    history = History()
    for second, calls in enumerate([0, 1, *[1] * 10]):
        history.add(both(second, calls))
        order = [row.name for row in history.services()]
        assert order == (["/a", "/b"] if second == 0 else ["/b", "/a"])


@pytest.mark.parametrize("hidden", [False, True])
def test_hidden_names_are_shown_only_on_request(hidden):
    secret = entry(nodes=("/_cli",), services=("/_add",))
    view = view_after(reading(0, of=secret, name="/_add"), hidden=hidden)
    assert (len(view.services), len(view.nodes)) == ((1, 1) if hidden else (0, 0))


def test_a_service_that_two_nodes_announce_counts_once():
    twice = entry(services=("/add", "/add"))
    view = view_after(reading(0, of=twice), reading(1, 10, of=twice))
    assert (view.services[0].per_second, view.nodes[0].calls_in) == (10, 10)


def test_a_task_server_works_while_a_task_runs():
    def row(state):
        return TaskRow(1, "move dock", 5, state, 0.0, 3.0, "/ada")

    assert TaskServerRow("/robot_task").state == "idle"
    assert TaskServerRow("/robot_task", tasks=(row("QUEUED"),)).state == "idle"
    assert TaskServerRow("/robot_task", tasks=(row("RUNNING"),)).state == "working"
    paused = TaskServerRow("/robot_task", True, 0, (row("PAUSED"),), Pose(0, 0, 0))
    assert paused.state == "paused"
