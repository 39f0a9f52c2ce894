"""Contract: every failure arrives as one typed error; only safe calls are retried."""

import asyncio

import pytest

import taskrpc
from tests.core.transport.helpers import (
    FAST,
    Add,
    Gate,
    add,
    ask,
    outcome,
    served,
    until,
)

# Errors


@pytest.mark.parametrize("code", [code for code in taskrpc.Code if code is not taskrpc.Code.OK])
async def test_a_callbacks_own_error_arrives_with_code_and_message(net, code):
    def refuse(request, response):
        raise taskrpc.HandlerError(code, f"because {code}")

    _, client = await served(net, refuse)
    with pytest.raises(taskrpc.HandlerFailed) as caught:
        await client.call(ask())
    assert (caught.value.code, caught.value.message) == (code, f"because {code}")
    assert caught.value.not_executed is (code is taskrpc.Code.UNAVAILABLE)


async def test_an_error_without_a_code_reaches_the_caller_and_the_log(net, caplog):
    def refuse(request, response):
        raise taskrpc.HandlerError("the arm is stuck")

    _, client = await served(net, refuse)
    with pytest.raises(taskrpc.HandlerFailed) as caught:
        await client.call(ask())
    text = "expected a code and a message, got only 'the arm is stuck'"
    assert caught.value.code is taskrpc.Code.INTERNAL
    assert text in caught.value.message
    assert text in caplog.text


class Odd(Exception):
    def __str__(self):
        raise ValueError("cannot be shown")


KINDS = [
    KeyError("secret"),
    ValueError(),
    StopIteration(1),
    StopAsyncIteration(),
    asyncio.CancelledError(),
    TimeoutError(),
    ConnectionResetError(104, "secret"),
    UnicodeDecodeError("utf-8", b"\xff", 0, 1, "secret"),
    ExceptionGroup("secret", [ValueError("secret")]),
    Odd(),
    taskrpc.ServiceUnavailable("secret"),
    taskrpc.DeadlineExceeded("secret"),
    taskrpc.InvalidRequest("secret", "secret"),
    RecursionError("secret"),
]


@pytest.mark.parametrize("error", KINDS, ids=lambda each: type(each).__name__)
@pytest.mark.parametrize("kind", ["plain", "async", "threaded"])
async def test_any_other_exception_tells_the_caller_only_where_to_look(net, kind, error, caplog):
    def plain(request, response):
        raise error

    async def suspending(request, response):
        await asyncio.sleep(0)
        raise error

    callback = suspending if kind == "async" else plain
    _, client = await served(net, callback, threaded=kind == "threaded")
    for _ in range(2):  # the first must not have blocked the service
        with pytest.raises(taskrpc.HandlerFailed) as caught:
            await client.call(ask())
        assert caught.value.code is taskrpc.Code.INTERNAL
        assert "secret" not in str(caught.value)
        assert "see the server's log, call " in str(caught.value)
    assert type(error).__name__ in caplog.text


def forgotten(request, response):
    response.sum = 1


def out_of_range(request, response):
    response.sum = 2**63
    return response


def other_type(request, response):
    return request


def no_message(request, response):
    return 42


@pytest.mark.parametrize(
    ("callback", "logged"),
    [
        (forgotten, "forgotten returned None; a service callback must `return response`"),
        (out_of_range, "sum: expected int64 in"),
        (other_type, "expected a example_interfaces/srv/AddTwoInts_Response"),
        (no_message, "got int"),
    ],
)
async def test_a_response_that_cannot_be_sent_is_the_handlers_failure(
    net, callback, logged, caplog
):
    _, client = await served(net, callback)
    with pytest.raises(taskrpc.HandlerFailed, match="see the server's log"):
        await client.call(ask())
    assert logged in caplog.text


async def test_a_handlers_error_with_a_non_string_message_arrives(net):
    def refuse(request, response):
        raise taskrpc.HandlerError("NOT_FOUND", 404)

    _, client = await served(net, refuse)
    with pytest.raises(taskrpc.HandlerFailed, match="404"):
        await client.call(ask())


async def test_an_invalid_request_names_the_field_and_is_not_sent(net):
    gate = Gate()
    _, client = await served(net, gate)
    for attempt in (client.call, client.call_async):
        with pytest.raises(taskrpc.InvalidRequest, match="b: expected int64, got 'x'") as caught:
            await attempt(ask(1, "x"))
        assert caught.value.path == "b"
    with pytest.raises(taskrpc.InvalidRequest, match=r"expected a .*AddTwoInts_Request"):
        await client.call(Add.Response())
    assert not gate.started


async def test_the_server_checks_for_itself(net, monkeypatch):
    gate = Gate()
    _, client = await served(net, gate)
    with monkeypatch.context() as patch:
        patch.setattr(client._channel, "_encode", lambda request: b"\x92\x01\xa1x")  # [1, "x"]
        with pytest.raises(taskrpc.InvalidRequest) as caught:
            await client.call(ask())
    assert caught.value.path == "b"
    assert caught.value.not_executed
    assert not gate.started
    gate.opened.set()
    assert (await client.call(ask(1))).sum == 1


async def test_another_definition_is_refused_with_both_hashes(net, caplog):
    class Mine:
        Request, Response = Add.Request, Add.Response
        _TYPE, _HASH, _DEFINITION = Add._TYPE, "RIHS01_" + "ab" * 32, ""

    server = await net.node()
    server.create_service(Add, "add", add)
    client = await net.client(Mine, "add")
    with pytest.raises(taskrpc.TypeMismatch) as caught:
        await client.call(ask())
    assert Add._HASH[:15] in str(caught.value)
    assert Mine._HASH[:15] in str(caught.value)
    assert caught.value.not_executed
    assert not await client.wait_for_service(0.2)
    assert not client.service_is_ready()
    assert caplog.text.count("another definition") == 1


async def test_an_unknown_service_answers_at_once(net):
    client = await net.client(Add, "nobody")
    began = asyncio.get_running_loop().time()
    with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /nobody") as caught:
        await client.call(ask())
    assert caught.value.not_executed
    assert asyncio.get_running_loop().time() - began < (1e-9 if net.is_virtual else 0.5)


# Retries


def counting(errors):
    calls = []

    def callback(request, response):
        calls.append(request.a)
        if len(calls) <= errors:
            raise taskrpc.HandlerError("UNAVAILABLE" if request.b else "ABORTED", "not yet")
        return response

    return calls, callback


async def test_a_call_that_certainly_did_not_run_is_repeated(net):
    calls, callback = counting(3)
    _, client = await served(net, callback, idempotent=False)
    await client.call(ask(1, 1), retry=FAST)
    assert calls == [1, 1, 1, 1]


async def test_a_call_that_ran_is_never_retried(net):
    calls, callback = counting(3)
    _, client = await served(net, callback)
    with pytest.raises(taskrpc.HandlerFailed):
        await client.call(ask(1, 0), retry=FAST)
    assert calls == [1]


async def test_the_number_of_attempts_is_kept(net):
    calls, callback = counting(9)
    _, client = await served(net, callback, idempotent=True)
    policy = taskrpc.RetryPolicy(attempts=3, wait_initial=0.001)
    with pytest.raises(taskrpc.HandlerFailed):
        await client.call(ask(1, 1), retry=policy)
    assert calls == [1, 1, 1]


@pytest.mark.parametrize("idempotent", [True, False])
async def test_an_unknown_outcome_is_repeated_only_where_that_does_no_harm(net, idempotent):
    gate, again = Gate(), Gate()
    again.opened.set()
    first, second = await net.node("first"), await net.node("second")
    first.create_service(Add, "gate", gate, idempotent=idempotent)
    client = await net.client(Add, "gate", retry=FAST)
    call = client.call_async(ask(4))
    await until(lambda: gate.started)
    second.create_service(Add, "gate", again, idempotent=idempotent, join=True)
    await first.destroy()
    result = await outcome(call)
    if idempotent:
        assert result.sum == 4
    else:
        assert isinstance(result, taskrpc.OutcomeUnknown)
        assert not again.started


async def test_with_a_policy_a_call_waits_for_its_server(net):
    client = await net.client(Add, "late", retry=FAST)
    call = client.call_async(ask(1, 2), timeout=5)
    await asyncio.sleep(0.05)
    server = await net.node()
    server.create_service(Add, "late", add)
    assert (await call).sum == 3


async def test_with_a_policy_and_no_server_a_call_ends_at_its_deadline(net):
    client = await net.client(Add, "nobody", retry=FAST)
    began = asyncio.get_running_loop().time()
    with pytest.raises(taskrpc.ServiceUnavailable):
        await client.call(ask(), timeout=0.2)
    assert 0.19 <= asyncio.get_running_loop().time() - began < 2
