"""Metrics count each call once, by service and status code, and the current load."""

import asyncio
import time

import pytest

import taskrpc
from taskrpc.observe.metrics import Family, Kind, Sample, collector, render, store_families
from tests.core.transport.helpers import Add, Gate, add, ask, until
from tests.observe.metrics.exposition import read, values


class Lab:
    """A server with metrics and a client with others."""

    def __init__(self):
        self.metrics, self.theirs = taskrpc.Metrics(), taskrpc.Metrics()
        options = {"transport": "memory"}
        self.server = taskrpc.Node("server", token="s", observer=self.metrics, **options)
        self.client = taskrpc.Node("client", token="c", observer=self.theirs, **options)

    async def __aenter__(self):
        await self.server.start()
        await self.client.start()
        return self

    async def __aexit__(self, *_):
        await self.client.destroy()
        await self.server.destroy()

    def offer(self, callback, name="work", **options):
        self.server.create_service(Add, name, callback, **options)
        return self.client.create_client(Add, name)


@pytest.fixture
async def lab():
    async with Lab() as made:
        yield made


async def test_calls_are_counted_by_service_and_outcome_on_both_sides(lab):
    def picky(request, response):
        if request.a:
            raise taskrpc.HandlerError("NOT_FOUND", "no")
        return response

    work, other = lab.offer(picky), lab.offer(add, "other")
    for number in (0, 0, 1):
        await asyncio.wait([work.call_async(ask(number))])
    await other.call(ask())
    expected = {"OK//other": 1, "NOT_FOUND//work": 1, "OK//work": 2}
    assert values(lab.metrics.text(), "taskrpc_calls_total") == expected
    assert values(lab.theirs.text(), "taskrpc_client_calls_total") == expected
    assert "taskrpc_client_calls_total" not in read(lab.metrics.text())


async def test_times_are_those_of_the_server_and_of_the_client(lab):
    async def slow(request, response):
        await asyncio.sleep(2)
        return response

    await lab.offer(slow).call(ask())
    times = values(lab.metrics.text(), "taskrpc_call_seconds")
    assert times["_bucket/1//work"] == 0
    assert times["_bucket/2.5//work"] == times["_count//work"] == 1
    assert times["_sum//work"] == pytest.approx(2, abs=0.01)
    theirs = values(lab.theirs.text(), "taskrpc_client_call_seconds")
    assert theirs["_sum//work"] >= times["_sum//work"]


async def test_running_and_waiting_calls_are_counted(lab):
    gate = Gate()
    client = lab.offer(gate)
    calls = [client.call_async(ask()) for _ in range(5)]
    await asyncio.sleep(1)
    text = lab.metrics.text()
    assert values(text, "taskrpc_calls_running") == {"/work": 1}
    assert values(text, "taskrpc_calls_waiting") == {"/work": 4}
    gate.opened.set()
    await asyncio.gather(*calls)
    assert values(lab.metrics.text(), "taskrpc_calls_waiting") == {"/work": 0}


async def test_counts_of_connections_and_bytes_survive_the_connections(lab):
    await lab.offer(add).call(ask())
    text, theirs = lab.metrics.text(), lab.theirs.text()
    assert values(text, "taskrpc_connections_open") == {"client": 0, "server": 1}
    sent = values(theirs, "taskrpc_sent_bytes_total")["client"]
    assert values(text, "taskrpc_received_bytes_total")["server"] == sent > 0
    await lab.client.destroy()
    await asyncio.sleep(1)
    text = lab.metrics.text()
    assert values(text, "taskrpc_connections_open")["server"] == 0
    assert values(text, "taskrpc_connections_total")["server"] == 1
    assert sum(values(text, "taskrpc_connections_ended_total").values()) == 1
    assert values(text, "taskrpc_received_bytes_total")["server"] >= sent
    after = values(lab.theirs.text(), "taskrpc_sent_bytes_total")["client"]
    assert after >= sent, "a counter never falls, also when its node is gone"


async def test_a_connection_that_is_cut_off_is_counted_by_its_reason(lab):
    await lab.offer(add).call(ask())
    (served,) = lab.server._transport._served
    served.abort(taskrpc.errors.ProtocolError("garbage"))
    await asyncio.sleep(1)
    text = lab.metrics.text()
    assert values(text, "taskrpc_connections_ended_total") == {"ProtocolError/server": 1}


async def test_nodes_that_share_their_sockets_are_counted_once(lab):
    async with taskrpc.Node("second", transport="memory", token="s", observer=lab.metrics):
        await lab.offer(add).call(ask())
        text = lab.metrics.text()
        assert values(text, "taskrpc_connections_open")["server"] == 1


async def test_retries_are_counted_and_do_not_fall_with_their_node(lab):
    answers = iter([taskrpc.HandlerError("UNAVAILABLE", "not yet")] * 2)

    def reluctant(request, response):
        for error in answers:
            raise error
        return response

    await lab.offer(reluctant).call(ask(), retry=taskrpc.RetryPolicy())
    for _ in range(2):
        assert values(lab.theirs.text(), "taskrpc_client_retries_total") == {"/work": 2}
        await lab.client.destroy()


async def test_added_family_is_included(lab):
    lab.metrics.add(lambda: [Family("battery", Kind.GAUGE, "How full.", [Sample(0.5)])])
    assert values(lab.metrics.text(), "battery") == {"": 0.5}


@pytest.mark.real_time
async def test_a_loop_that_is_held_up_is_late():
    metrics = taskrpc.Metrics()
    async with taskrpc.Node("node", transport="memory", observer=metrics):
        time.sleep(0.7)
        await asyncio.sleep(0.01)
        late = values(metrics.text(), "taskrpc_loop_late_seconds")
    assert late["_count"] == 1
    assert late["_sum"] > 0.1
    await asyncio.sleep(0)
    assert metrics._loop_lateness._timer is None


async def test_exactly_once_requests_are_counted_by_the_state_of_the_ledger(lab):
    gate = Gate()
    client = lab.offer(gate, exactly_once=taskrpc.MemoryCompletions())
    first = client.call_async(ask(1), request_id="one")
    await until(lambda: gate.started)
    again = client.call_async(ask(1), request_id="one")
    with pytest.raises(taskrpc.RequestIdReused):
        await client.call(ask(2), request_id="one")
    gate.opened.set()
    await asyncio.gather(first, again)
    await client.call(ask(1), request_id="one")
    told = values(lab.metrics.text(), "taskrpc_exactly_once_requests_total")
    counts = {"new": 1, "attach": 1, "reused": 1, "done": 1, "stale": 0, "full": 0}
    assert told == {f"{known}//work": count for known, count in counts.items()}
    assert values(lab.metrics.text(), "taskrpc_exactly_once_clients") == {"/work": 1}
    (size,) = values(lab.metrics.text(), "taskrpc_exactly_once_bytes").values()
    assert 500 < size < 2000
    await lab.server.destroy()
    assert values(lab.metrics.text(), "taskrpc_exactly_once_requests_total") == told


async def test_plain_services_tell_nothing_about_repeated_requests(lab):
    await lab.offer(add).call(ask())
    assert "exactly_once" not in lab.metrics.text()


async def test_a_program_that_makes_up_names_does_not_fill_a_prometheus(lab, monkeypatch):
    monkeypatch.setattr(collector, "MAX_SERVICES", 3)
    for number in range(10):
        client = lab.client.create_client(Add, f"made_up_{number}")
        with pytest.raises(taskrpc.ServiceUnavailable):
            await client.call(ask())
        client.destroy()
    told = values(lab.theirs.text(), "taskrpc_client_calls_total")
    assert told["UNIMPLEMENTED/(others)"] == 7
    assert len(told) == 4
    assert "made_up" not in lab.metrics.text()
    assert "taskrpc_client_retries_total" not in lab.theirs.text()


async def test_a_file_tells_how_many_changes_were_stored_together(tmp_path):
    store = taskrpc.SqliteCompletions(tmp_path / "a.db")
    for count in (1, 5, 5):
        await asyncio.gather(*(store.complete(None, []) for _ in range(count)))
    await store.close()
    name = "taskrpc_store_transaction_changes"
    told = values(render(store_families(store)), name)
    assert (told["_sum"], told["_count"]) == (11, 3)
    assert (told["_bucket/1"], told["_bucket/4"], told["_bucket/8"]) == (1, 1, 3)


async def test_metric_that_fails_does_not_hide_the_others(lab, caplog):
    lab.metrics.add(lambda: [Family("lab_total", Kind.COUNTER, "Lab.", [Sample(1 / 0)])])
    lab.metrics.add(lambda: [Family("cats", Kind.GAUGE, "Cats.", [Sample(2)])])
    assert values(lab.metrics.text(), "cats") == {"": 2}
    assert "a part of the metrics cannot be collected" in caplog.text
