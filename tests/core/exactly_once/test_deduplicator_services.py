"""A request of an exactly-once service runs once, also after repetitions and crashes."""

import asyncio
import contextlib
import sqlite3
import threading
import time

import pytest
from msgspec.structs import replace

import srvgen
import taskrpc
from taskrpc.core.exactly_once import Effect
from taskrpc.core.exactly_once.store_state import state_of
from taskrpc.core.request_ids.ids import RequestId, StoredCompletions
from taskrpc.core.request_ids.ledger import Ledger
from taskrpc.core.transport.connection.client_side import OpenCall
from taskrpc.core.transport.pipe import Pipe
from taskrpc.core.wire.frames import FrameType, pack_frame
from taskrpc.errors import (
    Code,
    DeadlineExceeded,
    HandlerError,
    HandlerFailed,
    InvalidRequest,
    OutcomeUnknown,
    RequestIdReused,
    ServerBusy,
    ServiceUnavailable,
    StoreError,
    TaskRpcError,
)

Add = srvgen.load("example_interfaces/srv/AddTwoInts")


class Store:
    """Stores effects and completions; tests can delay commits with `gate` or let one fail."""

    def __init__(self, store_id=b"S" * 16):
        self.store_id = store_id
        self.completions, self.effects, self.commits = {}, [], 0
        self.gate = self.opened = None
        self.fail_with = None

    async def recall(self):
        if self.opened is not None:
            await self.opened.wait()
        return StoredCompletions(self.store_id, tuple(self.completions.values()))

    async def complete(self, completion, effect, forgotten=()):
        if self.gate is not None:
            await self.gate.wait()
        if self.fail_with is not None:
            error, self.fail_with = self.fail_with, None
            raise error
        self.commits += 1
        if effect is not None:
            self.effects.append(effect)
        if completion is not None:
            for key in [k for k in self.completions if k[0] == completion.client]:
                if key[1] < completion.first_incomplete:
                    del self.completions[key]
            self.completions[completion.client, completion.sequence] = completion


class Counter:
    """A callback that adds and counts its executions."""

    def __init__(self):
        self.ran = 0
        self.gate = None

    async def __call__(self, request, response):
        self.ran += 1
        if self.gate is not None:
            await self.gate.wait()
        response.sum = request.a + request.b
        return Effect(response, f"{request.a}+{request.b}")


class Lab:
    """A server and a client that do not share an endpoint."""

    def __init__(self, store, counter, **options):
        self.store, self.counter, self.options = store, counter, options

    async def __aenter__(self):
        self.server = taskrpc.Node("server", transport="memory", token="server")
        await self.server.start()
        self.node = taskrpc.Node("client", transport="memory", token="client")
        await self.node.start()
        self.service = self.offer(self.server)
        self.client = self.node.create_client(Add, "add")
        assert await self.client.wait_for_service(timeout=60)
        return self

    def offer(self, node):
        return node.create_service(
            Add, "add", self.counter, exactly_once=self.store, **self.options
        )

    async def restart(self, store=None):
        """End the server and start another, with the same store or this one."""
        await self.server.destroy()
        self.store = store or self.store
        self.server = taskrpc.Node("server", transport="memory", token="another")
        await self.server.start()
        self.offer(self.server)

    async def __aexit__(self, *_):
        await self.node.destroy()
        await self.server.destroy()

    def cut(self):
        """Abort the connection, as if a cable were cut."""
        connection = self.client._channel._connection
        if connection is not None and isinstance(connection.transport, Pipe):
            connection.transport.abort()


async def turns(count=20):
    for _ in range(count):
        await asyncio.sleep(0)


async def test_response_is_sent_after_effect_and_completion_are_stored_together():
    async with Lab(Store(), Counter()) as lab:
        lab.store.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2)))
        await turns()
        assert lab.counter.ran == 1
        assert not call.done()
        lab.store.gate.set()
        assert (await call).sum == 3
        assert lab.store.effects == ["1+2"]
        assert len(lab.store.completions) == 1


async def test_lost_response_is_sent_again_without_a_second_execution():
    async with Lab(Store(), Counter()) as lab:
        lab.store.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2)))
        await turns()
        lab.cut()
        lab.store.gate.set()
        assert (await call).sum == 3
        assert lab.counter.ran == 1
        assert lab.store.effects == ["1+2"]


async def test_repeated_call_attaches_to_the_execution_that_began_before_the_connection_was_lost():
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2)))
        await turns()
        lab.cut()
        await asyncio.sleep(0.3)
        assert lab.counter.ran == 1
        assert not call.done()
        lab.counter.gate.set()
        assert (await call).sum == 3
        assert lab.store.effects == ["1+2"]


async def test_next_server_of_a_store_returns_the_stored_responses():
    store, counter = Store(), Counter()
    async with Lab(store, counter) as lab:
        store.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2)))
        await turns()
        lab.cut()  # before the answer can be sent
        store.gate.set()
        await lab.restart()
        assert (await call).sum == 3
        assert store.effects == ["1+2"]


async def test_server_of_another_store_does_not_run_a_request_that_may_have_run():
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2)))
        await turns()
        lab.cut()
        await lab.restart(Store(b"T" * 16))
        with pytest.raises(OutcomeUnknown, match="another store"):
            await call
        assert lab.counter.ran == 1
        assert lab.store.effects == []


async def test_unsent_call_goes_to_the_new_store():
    async with Lab(Store(), Counter()) as lab:
        await lab.client.call(Add.Request(a=1, b=2))
        await lab.restart(Store(b"T" * 16))
        assert await lab.client.wait_for_service(timeout=60)
        assert (await lab.client.call(Add.Request(a=3, b=4))).sum == 7
        assert lab.store.effects == ["3+4"]


async def test_call_that_crosses_a_withdrawal_goes_to_the_next_server():
    async with Lab(Store(), Counter()) as lab:
        async with taskrpc.Node("next", transport="memory", token="next") as following:
            lab.service.destroy()
            lab.offer(following)
            assert lab.client._channel.ready, "the client has not been notified yet"
            assert (await lab.client.call(Add.Request(a=1, b=2), timeout=5)).sum == 3
        assert lab.store.effects == ["1+2"]


async def test_forgotten_client_begins_with_new_sequence_numbers():
    async with Lab(Store(), Counter()) as lab:
        await lab.client.call(Add.Request(a=1, b=2))
        await lab.restart(Store())  # a store with the same id, and empty
        assert await lab.client.wait_for_service(timeout=60)
        assert (await lab.client.call(Add.Request(a=3, b=4))).sum == 7


async def test_a_request_id_names_one_request_for_every_program():
    async with Lab(Store(), Counter()) as lab:
        request = Add.Request(a=1, b=2)
        first = await lab.client.call(request, request_id="monday")
        async with taskrpc.Node("other", transport="memory", token="other") as other:
            client = other.create_client(Add, "add")
            await client.wait_for_service(timeout=5)
            again = await client.call(request, request_id="monday")
            assert (first.sum, again.sum, lab.counter.ran) == (3, 3, 1)
            assert (await client.call(request, request_id="tuesday")).sum == 3
            assert lab.counter.ran == 2
            with pytest.raises(RequestIdReused) as caught:
                await client.call(Add.Request(a=5, b=5), request_id="monday")
            assert caught.value.not_executed
        assert lab.counter.ran == 2


async def test_request_id_is_refused_for_a_service_that_is_not_exactly_once():
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", lambda request, response: response)
        client = node.create_client(Add, "add")
        await client.wait_for_service(timeout=5)
        with pytest.raises(InvalidRequest, match="not exactly-once"):
            await client.call(Add.Request(), request_id="x")


async def test_service_that_is_not_exactly_once_refuses_numbered_requests():
    ran = []
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", lambda request, response: ran.append(1))
        client = node.create_client(Add, "add")
        await client.wait_for_service(timeout=5)
        call = client._channel.send(Add.Request(), None, RequestId(b"c" * 16, 1, 1))
        with pytest.raises(TaskRpcError, match="not exactly-once"):
            await asyncio.wait_for(call.future, 60)
        assert ran == []


async def test_error_of_a_handler_is_stored_and_returned_again():
    ran = []

    def refuse(request, response):
        ran.append(request.a)
        raise HandlerError(Code.OUT_OF_RANGE, "too large")

    async with Lab(Store(), refuse) as lab:
        for _ in range(2):
            with pytest.raises(HandlerFailed, match="too large") as caught:
                await lab.client.call(Add.Request(a=1), request_id="x")
            assert caught.value.code is Code.OUT_OF_RANGE
        assert ran == [1]


@pytest.mark.parametrize(("code", "said"), [(Code.NOT_FOUND, "no \udcff"), (Code.OK, "well")])
async def test_unusual_error_of_a_handler_is_stored_too(code, said):
    ran = []

    async def refuse(request, response):
        ran.append(request.a)
        await asyncio.sleep(0)
        raise HandlerError(code, said)

    async with Lab(Store(), refuse) as lab:
        for _ in range(2):
            with pytest.raises(HandlerFailed, match=r"no .udcff|well"):
                await lab.client.call(Add.Request(a=1), timeout=1, request_id="x")
        assert ran == [1]


async def test_request_with_nothing_done_may_run_later():
    ran = []

    def later(request, response):
        ran.append(request.a)
        if len(ran) == 1:
            taskrpc.current_call().nothing_done()
        response.sum = len(ran)
        return response

    async with Lab(Store(), later) as lab:
        answers = [await lab.client.call(Add.Request(a=1), request_id="x") for _ in range(3)]
        assert [each.sum for each in answers] == [1, 2, 2]
        assert lab.store.commits == 1


async def test_call_of_an_unavailable_handler_is_repeated():
    ran = []

    def later(request, response):
        ran.append(request.a)
        if len(ran) < 3:
            raise HandlerError(Code.UNAVAILABLE, "not yet")
        return response

    async with Lab(Store(), later) as lab:
        with pytest.raises(HandlerFailed, match="not yet"):
            await lab.client.call(Add.Request(a=1))
        await lab.client.call(Add.Request(a=1), timeout=5, retry=taskrpc.RetryPolicy())
        assert len(ran) == 3


async def test_request_that_the_store_refuses_may_run_later():
    async with Lab(Store(), Counter()) as lab:
        lab.store.fail_with = TaskRpcError("the disk is full")
        with pytest.raises(HandlerFailed, match="the disk is full") as caught:
            await lab.client.call(Add.Request(a=1, b=2), request_id="x")
        assert caught.value.not_executed
        assert (await lab.client.call(Add.Request(a=1, b=2), request_id="x")).sum == 3
        assert lab.counter.ran == 2
        assert lab.store.effects == ["1+2"]


async def test_the_caller_never_sees_sql(caplog):
    def forget(request, response):
        return Effect(response, [("DELETE FROM secrets", ())])

    async with Lab(taskrpc.MemoryCompletions(), forget) as lab:
        with pytest.raises(HandlerFailed) as caught:
            await lab.client.call(Add.Request())
    assert str(caught.value) == "nothing was stored; the server's log says why"
    assert caught.value.not_executed
    assert "no such table: secrets" in caplog.text


async def test_store_with_an_unknown_outcome_is_read_again_before_the_next_decision():
    async with Lab(Store(), Counter()) as lab:
        complete = lab.store.complete

        async def torn(*stored):
            lab.store.complete = complete
            await complete(*stored)
            raise OutcomeUnknown("the disk did not say")

        lab.store.complete = torn
        assert (await lab.client.call(Add.Request(a=1, b=2), timeout=5)).sum == 3
        assert lab.counter.ran == 1
        assert lab.store.effects == ["1+2"]


@pytest.mark.parametrize("error", [OSError("gone"), asyncio.CancelledError(), ValueError("?")])
async def test_any_other_error_of_a_store_leaves_the_outcome_unknown(error):
    async with Lab(Store(), Counter()) as lab:
        complete = lab.store.complete

        async def torn(*stored):
            lab.store.complete = complete
            await complete(*stored)
            raise error

        lab.store.complete = torn
        assert (await lab.client.call(Add.Request(a=1, b=2), timeout=5)).sum == 3
        assert lab.counter.ran == 1
        assert lab.store.effects == ["1+2"]


async def test_callback_that_fails_after_storing_its_effect_is_not_executed_again():
    store, ran = Store(), []

    async def stores(request, response):
        ran.append(request.a)
        response.sum = 3
        await store.complete(taskrpc.current_call().completed_by(response), "mine")
        raise KeyError("too late")

    async with Lab(store, stores) as lab:
        assert (await lab.client.call(Add.Request(a=1), timeout=5)).sum == 3
        assert (ran, store.effects) == ([1], ["mine"])


@pytest.mark.parametrize("threaded", [False, True])
async def test_running_calls_of_an_abandoned_service_have_an_unknown_outcome(threaded):
    over = threading.Event()

    async def waits(request, response):
        await asyncio.to_thread(over.wait)
        return response

    callback = (lambda _, response: over.wait() and response) if threaded else waits
    async with Lab(Store(), callback, threaded=threaded) as lab:
        try:
            call = asyncio.ensure_future(lab.client.call(Add.Request(), timeout=0.2))
            await turns()
            lab.service.abandon()
            with pytest.raises(OutcomeUnknown):
                await call
        finally:
            over.set()


async def test_completion_that_is_stored_while_the_store_is_read_is_kept():
    async with Lab(Store(), Counter()) as lab:
        store, counter = lab.store, lab.counter
        complete, recall, read = store.complete, store.recall, asyncio.Event()

        async def torn(*_):
            store.complete = complete
            raise OutcomeUnknown("the disk did not say")

        async def slow():
            found = await recall()
            await read.wait()
            return found

        counter.gate, store.complete, store.recall = asyncio.Event(), torn, slow
        calls = [lab.client.call_async(Add.Request(a=n), request_id=f"{n}") for n in range(3)]
        await turns()
        counter.gate.set()
        await turns()
        assert store.effects == ["1+0", "2+0"]
        read.set()
        assert [(await call).sum for call in calls] == [0, 1, 2]
        for n in range(3):
            await lab.client.call(Add.Request(a=n), request_id=f"{n}")
        assert store.effects == ["1+0", "2+0", "0+0"]


async def test_cancel_by_the_only_caller_cancels_the_execution_and_a_repetition_runs():
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2), request_id="x"))
        await turns()
        call.cancel()
        await turns()
        lab.counter.gate.set()
        assert lab.store.effects == []
        assert (await lab.client.call(Add.Request(a=1, b=2), request_id="x")).sum == 3
        assert lab.store.effects == ["1+2"]


async def test_cancel_by_one_of_two_callers_does_not_affect_the_other():
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        request = Add.Request(a=1, b=2)
        calls = [asyncio.ensure_future(lab.client.call(request, request_id="x")) for _ in range(2)]
        await turns()
        calls[0].cancel()
        await turns()
        lab.counter.gate.set()
        assert (await calls[1]).sum == 3
        assert lab.counter.ran == 1


async def test_repeated_cancel_does_not_affect_another_attempt():
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        channel, number = lab.client._channel, RequestId(b"c" * 16, 1, 1)
        connection = channel._connection
        cancelled = channel.send(Add.Request(a=1, b=2), None, number)
        cancel = pack_frame(FrameType.CANCEL, 0, 0, cancelled.call_id, 0, b"")
        connection.session.out += [cancel, cancel]
        call = channel.send(Add.Request(a=1, b=2), None, number)
        connection.flush()
        await turns()
        lab.counter.gate.set()
        assert (await asyncio.wait_for(call.future, 60)).sum == 3
        assert lab.store.effects == ["1+2"]
        with pytest.raises(TaskRpcError, match="cancelled"):
            await cancelled.future


async def test_cancel_during_the_commit_has_no_effect():
    async with Lab(Store(), Counter()) as lab:
        lab.store.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2), request_id="x"))
        await turns()
        call.cancel()
        await turns()
        lab.store.gate.set()
        assert (await lab.client.call(Add.Request(a=1, b=2), request_id="x")).sum == 3
        assert lab.counter.ran == 1
        assert lab.store.effects == ["1+2"]


async def test_lost_caller_that_does_not_return_leaves_no_execution_behind():
    async with Lab(Store(), Counter(), concurrency=1) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2), timeout=0.2))
        await turns()
        await lab.node.destroy()
        with pytest.raises(TaskRpcError):
            await call
        assert lab.service.status().running == 1
        await asyncio.sleep(0.3)
        assert lab.service.status().running == 0
        assert lab.store.effects == []


async def test_outcome_of_an_expired_call_is_unknown():
    async with Lab(Store(), Counter()) as lab:
        lab.store.gate = asyncio.Event()
        with pytest.raises(DeadlineExceeded) as caught:
            await lab.client.call(Add.Request(a=1, b=2), timeout=0.05)
        assert caught.value.not_executed is None
        lab.store.gate.set()
        await turns()
        assert lab.store.effects == ["1+2"]


@pytest.mark.parametrize("others", [0, 1])
async def test_server_reports_an_unknown_outcome_for_an_expired_repetition(others, monkeypatch):
    monkeypatch.setattr(OpenCall, "expired", lambda _: None)  # as if the client's loop were late
    async with Lab(Store(), Counter(), concurrency=1) as lab:
        lab.counter.gate = asyncio.Event()
        calls = [lab.client.call_async(Add.Request(a=1, b=n), request_id=f"{n}") for n in range(2)]
        await turns()
        which = 1 if others else 0
        repeated = lab.client.call_async(
            Add.Request(a=1, b=which), timeout=0.05, request_id=f"{which}"
        )
        with pytest.raises(DeadlineExceeded) as caught:
            await repeated
        assert caught.value.not_executed is None
        lab.counter.gate.set()
        await asyncio.gather(*calls)


async def test_call_that_expires_in_the_queue_is_reported_as_not_executed(monkeypatch):
    monkeypatch.setattr(OpenCall, "expired", lambda _: None)
    async with Lab(Store(), Counter(), concurrency=1) as lab:
        lab.counter.gate = asyncio.Event()
        call = lab.client.call_async(Add.Request(a=1))
        await turns()
        with pytest.raises(DeadlineExceeded) as caught:
            await lab.client.call(Add.Request(a=2), timeout=0.05)
        assert caught.value.not_executed is True
        lab.counter.gate.set()
        await call
        assert lab.counter.ran == 1


async def test_call_that_may_have_run_is_never_reported_as_not_run():
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1, b=2), timeout=0.5))
        await turns()
        lab.cut()
        await lab.server.destroy()
        with pytest.raises(OutcomeUnknown):
            await call


async def test_calls_wait_for_a_store_that_is_being_opened():
    store = Store()
    store.opened = asyncio.Event()
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", Counter(), exactly_once=store)
        client = node.create_client(Add, "add")
        call = asyncio.ensure_future(client.call(Add.Request(a=1, b=2)))
        await turns()
        assert not call.done()
        store.opened.set()
        assert (await call).sum == 3


async def test_error_names_a_store_that_cannot_be_opened():
    class Broken(Store):
        async def recall(self):
            raise TaskRpcError("tasks.db is damaged")

    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", Counter(), exactly_once=Broken())
        with pytest.raises(ServiceUnavailable, match=r"tasks\.db is damaged"):
            await node.create_client(Add, "add").call(Add.Request(), timeout=1)


async def test_a_store_that_could_not_be_read_is_read_again():
    async with Lab(Store(), Counter()) as lab:
        recall = lab.store.recall

        async def broken():
            lab.store.recall = recall
            raise TaskRpcError("the disk is away")

        lab.store.recall, lab.store.fail_with = broken, OutcomeUnknown("the disk did not say")
        assert (await lab.client.call(Add.Request(a=1, b=2), timeout=5)).sum == 3
        assert lab.store.effects == ["1+2"]


async def test_store_that_could_not_be_read_at_first_is_used_when_it_can_be_read():
    store, broken = Store(), [True]
    recall = store.recall

    async def mended():
        if broken:
            raise TaskRpcError("the disk is away")
        return await recall()

    store.recall = mended
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", Counter(), exactly_once=store)
        client = node.create_client(Add, "add")
        with pytest.raises(ServiceUnavailable, match="away"):
            await client.call(Add.Request(), timeout=1)
        broken.clear()
        assert (await client.call(Add.Request(a=1), timeout=5)).sum == 1


async def test_repaired_store_can_be_offered_again():
    store, broken = Store(), [True]
    recall = store.recall

    async def mended():
        if broken:
            raise TaskRpcError("tasks.db is damaged")
        return await recall()

    store.recall = mended
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        service = server.create_service(Add, "add", Counter(), exactly_once=store)
        with pytest.raises(ServiceUnavailable, match="damaged"):
            await node.create_client(Add, "add").call(Add.Request(), timeout=1)
        service.destroy()
        broken.clear()
        server.create_service(Add, "add", Counter(), exactly_once=store)
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(timeout=60)
        assert (await client.call(Add.Request(a=1), timeout=5)).sum == 1


async def test_drain_waits_for_completions_that_are_being_stored():
    async with Lab(Store(), Counter()) as lab:
        lab.store.gate = asyncio.Event()
        call = lab.client.call_async(Add.Request(a=1, b=2))
        await turns()
        drained = asyncio.ensure_future(lab.server.drain())
        await turns()
        assert not drained.done()
        lab.store.gate.set()
        await drained
        await lab.server.destroy()
        assert (await asyncio.wait_for(call, 1)).sum == 3
        assert lab.client.retries == 0


async def test_a_store_serves_one_event_loop_at_a_time():
    async with Lab(Store(), Counter()) as lab:

        async def elsewhere():
            async with taskrpc.Node("elsewhere", transport="memory", token="e") as node:
                lab.offer(node)

        with pytest.raises(StoreError, match="another event loop"):
            await asyncio.to_thread(asyncio.run, elsewhere())
        lab.service.destroy()
        await asyncio.to_thread(asyncio.run, elsewhere())


async def test_two_services_of_one_store_share_its_sequence_numbers():
    async with Lab(Store(), Counter()) as lab:
        lab.server.create_service(Add, "double", lab.counter, exactly_once=lab.store)
        client = lab.node.create_client(Add, "double")
        await client.wait_for_service(timeout=5)
        for each in (client, lab.client, client):
            await each.call(Add.Request(a=1, b=1))
        assert {key[1] for key in lab.store.completions} == {3}


async def test_service_that_is_destroyed_twice_does_not_release_the_store_of_another(caplog):
    store = Store()
    async with Lab(store, Counter()) as lab:
        async with taskrpc.Node("second", transport="memory", token="2") as second:
            double = second.create_service(Add, "double", lab.counter, exactly_once=store)
            double.destroy()  # and its node follows at once
        assert state_of(store) is lab.service._deduplicator.state
        await lab.client.call(Add.Request(a=1))
    await turns()
    assert not caplog.records


@pytest.mark.parametrize("kind", ["plain", "async", "threaded"])
async def test_with_concurrency_one_each_call_sees_the_effect_of_the_previous_one(tmp_path, kind):
    path = tmp_path / "shop.db"
    store = taskrpc.SqliteCompletions(path, ["CREATE TABLE IF NOT EXISTS sold (seat INTEGER)"])

    def sell(request, response):
        with contextlib.closing(sqlite3.connect(path)) as connection:
            (response.sum,) = connection.execute("SELECT count(*) FROM sold").fetchone()
        return Effect(response, [("INSERT INTO sold VALUES (?)", (response.sum,))])

    async def sell_later(request, response):
        await asyncio.sleep(0)
        return sell(request, response)

    callback = sell_later if kind == "async" else sell
    async with Lab(store, callback, concurrency=1, threaded=kind == "threaded") as lab:
        calls = [lab.client.call_async(Add.Request()) for _ in range(10)]
        assert [(await call).sum for call in calls] == list(range(10))
    await store.close()


async def test_a_place_is_free_again_when_an_effect_cannot_be_stored():
    async with Lab(Store(), Counter(), concurrency=1) as lab:
        lab.store.fail_with = StoreError("the disk is full")
        first = lab.client.call_async(Add.Request(a=1))
        second = lab.client.call_async(Add.Request(a=2))
        with pytest.raises(HandlerFailed, match="full"):
            await first
        assert (await second).sum == 2


async def test_many_calls_at_once_each_run_once():
    async with Lab(Store(), Counter()) as lab:
        calls = [asyncio.ensure_future(lab.client.call(Add.Request(a=n))) for n in range(200)]
        for _ in range(3):
            await turns(3)
            lab.cut()
            await asyncio.sleep(0.01)
        assert [(await call).sum for call in calls] == list(range(200))
        assert sorted(lab.store.effects) == sorted(f"{n}+0" for n in range(200))


async def test_forgotten_client_with_a_call_in_doubt_gets_an_unknown_outcome():
    async with Lab(Store(), Counter()) as lab:
        await lab.client.call(Add.Request(a=1))
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=2)))
        await turns()
        lab.cut()
        await lab.restart(Store())
        with pytest.raises(OutcomeUnknown):
            await call
        assert lab.counter.ran == 2


class Clock:
    """Stands in for a store's `LeaseClock`."""

    def __init__(self, lab):
        lab.service._deduplicator.state.clock = self
        self.seconds = 1000.0

    @property
    def offset(self):
        return self.seconds - asyncio.get_running_loop().time()


async def test_store_also_forgets_a_client_whose_lease_has_ended():
    forgotten = []

    class Leased(Store):
        async def complete(self, completion, effect, clients=()):
            forgotten.extend(clients)
            await super().complete(completion, effect)

    async with Lab(Leased(), Counter()) as lab:
        clock = Clock(lab)
        await lab.client.call(Add.Request(a=1), request_id="old")
        clock.seconds += 24 * 3600 + 1
        await lab.client.call(Add.Request(a=2), request_id="new")
        assert len(forgotten) == 1


@pytest.mark.parametrize("leap", [1e6, -1e6])
async def test_clock_change_between_two_servers_ends_no_lease(leap):
    async with Lab(Store(), Counter()) as lab:
        await lab.client.call(Add.Request(a=1), request_id="monday")
        known = lab.store.completions.items()
        lab.store.completions = {key: replace(each, at=each.at - leap) for key, each in known}
        await lab.restart()
        assert await lab.client.wait_for_service(timeout=60)
        await lab.client.call(Add.Request(a=2), request_id="tuesday")
        await lab.client.call(Add.Request(a=1), request_id="monday")
        assert lab.counter.ran == 2


async def test_no_request_runs_twice_when_the_time_of_day_jumps(monkeypatch):
    async with Lab(Store(), Counter()) as lab:
        await lab.client.call(Add.Request(a=1), request_id="1")
        begin = time.time()
        for number, days in enumerate((20, 40, 60), 2):
            leapt = begin + days * 24 * 3600
            monkeypatch.setattr(time, "time", lambda leapt=leapt: leapt)
            await lab.restart()
            await lab.client.call(Add.Request(a=number), request_id=f"{number}")
        for number in range(1, 5):
            await lab.client.call(Add.Request(a=number), request_id=f"{number}")
        assert lab.counter.ran == 4


@pytest.mark.parametrize(("hours", "is_repeated"), [(11, True), (13, False)])
async def test_a_request_is_not_repeated_once_the_server_may_have_forgotten_it(
    monkeypatch, hours, is_repeated
):
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1), timeout=None))
        await turns()
        lab.cut()
        await turns()  # the call is in doubt, and waits a moment before it is sent again
        later = time.time() + hours * 3600
        monkeypatch.setattr(time, "time", lambda: later)
        lab.counter.gate.set()
        if is_repeated:
            assert (await call).sum == 1
        else:
            with pytest.raises(OutcomeUnknown, match="the server may have forgotten it"):
                await call
        assert lab.counter.ran == 1


async def test_clock_that_is_set_back_does_not_let_a_request_be_repeated_for_longer(monkeypatch):
    async with Lab(Store(), Counter()) as lab:
        lab.counter.gate = asyncio.Event()
        call = asyncio.ensure_future(lab.client.call(Add.Request(a=1), timeout=None))
        await turns()
        lab.cut()
        await turns()
        earlier = time.time() - 24 * 3600
        monkeypatch.setattr(time, "time", lambda: earlier)
        await asyncio.sleep(13 * 3600)  # the second attempt waits for the handler
        lab.cut()
        with pytest.raises(OutcomeUnknown, match="the server may have forgotten it"):
            await asyncio.wait_for(call, 60)


async def test_full_ledger_accepts_requests_again_when_leases_end():
    async with Lab(Store(), Counter()) as lab:
        lab.service._deduplicator.state.ledger = Ledger(memory=3000)
        clock = Clock(lab)
        await lab.client.call(Add.Request(a=1), request_id="one")
        await lab.client.call(Add.Request(a=1), request_id="two")
        with pytest.raises(ServerBusy, match="/add remembers too many requests"):
            await lab.client.call(Add.Request(a=1), request_id="three")
        clock.seconds += 24 * 3600 + 1
        await lab.client.call(Add.Request(a=1), request_id="three")
        assert lab.counter.ran == 3


async def test_store_that_cannot_forget_still_answers_callers():
    class Leased(Store):
        async def complete(self, completion, effect, clients=()):
            if clients:
                raise OSError("locked")
            await super().complete(completion, effect)

    async with Lab(Leased(), Counter()) as lab:
        clock = Clock(lab)
        await lab.client.call(Add.Request(a=1), request_id="old")
        clock.seconds += 24 * 3600 + 1
        assert (await lab.client.call(Add.Request(a=2), timeout=1, request_id="new")).sum == 2


async def test_store_is_read_again_when_it_may_have_forgotten_a_client():
    class Torn(Store):
        torn = False

        async def recall(self):
            self.torn = False
            return await super().recall()

        async def complete(self, completion, effect, clients=()):
            if clients:
                self.torn = True
                raise OutcomeUnknown("the disk did not say")
            if self.torn:
                raise StoreError("it must be opened anew")
            await super().complete(completion, effect)

    async with Lab(Torn(), Counter()) as lab:
        clock = Clock(lab)
        await lab.client.call(Add.Request(a=1), request_id="old")
        clock.seconds += 24 * 3600 + 1
        with pytest.raises(HandlerFailed, match="opened anew"):
            await lab.client.call(Add.Request(a=2), timeout=5, request_id="new")
        assert (await lab.client.call(Add.Request(a=2), timeout=5, request_id="new")).sum == 2


async def test_exactly_once_calls_wait_in_the_queue():
    async with Lab(Store(), Counter(), concurrency=1) as lab:
        lab.counter.gate = asyncio.Event()
        calls = [
            asyncio.ensure_future(lab.client.call(Add.Request(a=n), timeout=5)) for n in range(250)
        ]
        await turns()
        lab.counter.gate.set()
        assert [(await call).sum for call in calls] == list(range(250))


async def test_service_that_is_withdrawn_before_its_store_is_open_answers_its_callers():
    store = Store()
    store.opened = asyncio.Event()
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        service = server.create_service(Add, "add", Counter(), exactly_once=store)
        call = asyncio.ensure_future(node.create_client(Add, "add").call(Add.Request()))
        await turns()
        service.destroy()
        with pytest.raises(ServiceUnavailable):
            await call
        store.opened.set()
        server.create_service(Add, "add", Counter(), exactly_once=store)
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(timeout=60)
        assert (await client.call(Add.Request(a=1))).sum == 1
