"""Faults in calls: what the caller, the service and the log see."""

import asyncio
import contextlib
import logging

import pytest

import taskrpc
from taskrpc.testing import CallFaults
from tests.core.transport.helpers import Add, add

REQUEST = Add.Request(a=1, b=2)


@pytest.fixture(autouse=True)
def _log(caplog):
    caplog.set_level(logging.INFO, "taskrpc.server")


@contextlib.asynccontextmanager
async def programs(*specs, service="", **options):
    """A server with faults, its client, and the requests that the callback has handled."""
    handled = []

    def handle(request, response):
        handled.append(request)
        return add(request, response)

    faults = CallFaults(*specs, service=service)
    async with (
        taskrpc.Node("server", transport="memory", listen="server", faults=faults) as server,
        taskrpc.Node("user", transport="memory", listen="user") as user,
    ):
        server.create_service(Add, "add", handle, **options)
        yield user.create_client(Add, "add", timeout=5), handled, faults


def lines(caplog):
    return [each.getMessage() for each in caplog.records if each.name == "taskrpc.server"]


async def test_lost_response_times_out_and_the_retry_of_the_caller_gets_one(caplog):
    async with programs("lose-response:first=1") as (client, handled, faults):
        with pytest.raises(taskrpc.DeadlineExceeded) as lost:
            await client.call(REQUEST)
        assert lost.value.not_executed is not True
        assert len(handled) == 1
        assert (await client.call(REQUEST)).sum == 3
        assert len(handled) == 2
        assert faults.happened == {"lose-response": 1}
    assert lines(caplog) == ["fault in call 1 of /add from /user: the response is lost"]


async def test_lost_response_of_an_exactly_once_service_is_repeated_without_a_second_run():
    options = {"exactly_once": taskrpc.MemoryCompletions()}
    async with programs("lose-response:first=1", **options) as (client, handled, _):
        with pytest.raises(taskrpc.DeadlineExceeded) as lost:
            await client.call(REQUEST, request_id="monday-1")
        assert lost.value.not_executed is not True
        assert (await client.call(REQUEST, request_id="monday-1")).sum == 3
        assert len(handled) == 1


async def test_lost_request_times_out_and_never_reaches_the_callback(caplog):
    async with programs("lose-request:first=1") as (client, handled, _):
        with pytest.raises(taskrpc.DeadlineExceeded) as lost:
            await client.call(REQUEST)
        assert lost.value.not_executed is not True
        assert not handled
        assert (await client.call(REQUEST)).sum == 3
    assert lines(caplog) == ["fault in call 1 of /add from /user: the request is lost"]


async def test_late_response_arrives_late(caplog):
    async with programs("delay-response:2s,first=1") as (client, handled, _):
        began = asyncio.get_running_loop().time()
        calling = client.call_async(REQUEST)
        await asyncio.sleep(1)
        assert len(handled) == 1
        assert (await calling).sum == 3
        assert asyncio.get_running_loop().time() - began == pytest.approx(2, abs=0.1)
    assert lines(caplog) == ["fault in call 1 of /add from /user: the response is 2 s late"]


async def test_response_after_the_deadline_is_not_sent():
    async with programs("delay-response:9s,first=1") as (client, handled, _):
        with pytest.raises(taskrpc.DeadlineExceeded):
            await client.call(REQUEST)
        assert len(handled) == 1
        await asyncio.sleep(9)
        assert (await client.call(REQUEST)).sum == 3


async def test_late_response_that_cannot_be_sent_fails_the_call(caplog):
    def wrong(request, response):
        return None

    faults = CallFaults("delay-response:1s")
    async with (
        taskrpc.Node("server", transport="memory", listen="server", faults=faults) as server,
        taskrpc.Node("user", transport="memory", listen="user") as user,
    ):
        server.create_service(Add, "add", wrong)
        with pytest.raises(taskrpc.HandlerFailed, match="the handler failed"):
            await user.create_client(Add, "add", timeout=5).call(REQUEST)


async def test_slow_handler_responds_later_and_ends_with_its_caller():
    async with programs("slow:2s") as (client, handled, _):
        began = asyncio.get_running_loop().time()
        assert (await client.call(REQUEST)).sum == 3
        assert asyncio.get_running_loop().time() - began == pytest.approx(2, abs=0.1)
        with pytest.raises(taskrpc.DeadlineExceeded):
            await client.call(REQUEST, timeout=1)
        await asyncio.sleep(5)
        assert len(handled) == 1


async def test_busy_service_is_saved_by_a_retry(caplog):
    async with programs("busy:first=2") as (client, handled, faults):
        with pytest.raises(taskrpc.ServerBusy, match="an injected fault: /add is busy"):
            await client.call(REQUEST)
        assert (await client.call(REQUEST, retry=taskrpc.RetryPolicy(attempts=2))).sum == 3
        assert len(handled) == 1
        assert faults.happened == {"busy": 2}
    assert lines(caplog)[0] == "fault in call 1 of /add from /user: the caller gets ServerBusy"


async def test_cut_connection_leaves_the_outcome_unknown(caplog):
    async with programs("cut-connection:first=1") as (client, handled, _):
        with pytest.raises(taskrpc.OutcomeUnknown):
            await client.call(REQUEST)
        assert len(handled) == 1
        assert (await client.call(REQUEST)).sum == 3
    [line] = [line for line in lines(caplog) if line.startswith("fault in ")]
    assert line == "fault in call 1 of /add from /user: the connection is cut before the response"


async def test_client_of_an_exactly_once_service_survives_a_cut_connection():
    options = {"exactly_once": taskrpc.MemoryCompletions()}
    async with programs("cut-connection:first=1", **options) as (client, handled, _):
        assert (await client.call(REQUEST)).sum == 3
        assert len(handled) == 1


async def test_other_services_have_no_faults():
    async with programs("lose-request", service="/sub") as (client, _, faults):
        assert (await client.call(REQUEST)).sum == 3
        assert faults.happened == {"lose-request": 0}


async def test_calls_keep_their_faults_while_another_program_measures_them():
    async with programs("busy") as (client, handled, _):
        async with taskrpc.Node("watcher", transport="memory", listen="watcher") as watcher:
            with pytest.raises(taskrpc.ServerBusy):
                await client.call(REQUEST)
            await watcher.statistics(timeout=1)
            with pytest.raises(taskrpc.ServerBusy):
                await client.call(REQUEST)
        assert not handled


async def test_observer_sees_a_lost_response_as_an_error():
    ended = []

    class Log(taskrpc.Observer):
        def call_ended(self, call, code, seconds):
            ended.append((code, round(seconds)))

    faults = CallFaults("lose-response:first=1")
    async with (
        taskrpc.Node("s", transport="memory", listen="s", faults=faults, observer=Log()) as server,
        taskrpc.Node("user", transport="memory", listen="user") as user,
    ):
        server.create_service(Add, "add", add)
        client = user.create_client(Add, "add", timeout=5)
        with pytest.raises(taskrpc.DeadlineExceeded):
            await client.call(REQUEST)
        assert (await client.call(REQUEST)).sum == 3
    [(lost, seconds), (answered, _)] = ended
    assert lost in (taskrpc.Code.DEADLINE_EXCEEDED, taskrpc.Code.CANCELLED)
    assert seconds == 5
    assert answered is taskrpc.Code.OK


def test_invalid_specification_is_refused_at_once():
    with pytest.raises(ValueError, match="expected a fault, got 'lose'"):
        CallFaults("lose")
