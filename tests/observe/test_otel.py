"""Each call is a span with its outcome, on the side that answers and on the side that asks."""

import asyncio

import pytest
from opentelemetry import trace
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import SpanKind, StatusCode

import taskrpc
from taskrpc.observe.otel import Tracing
from tests.core.transport.helpers import Add, add, ask


class Lab:
    """Two nodes whose spans are kept."""

    def __init__(self):
        self.exporter = InMemorySpanExporter()
        self.provider = TracerProvider()
        self.provider.add_span_processor(SimpleSpanProcessor(self.exporter))
        self.tracing = Tracing(self.provider)

    async def __aenter__(self):
        self.server = taskrpc.Node("server", transport="memory", token="s", observer=self.tracing)
        self.client = taskrpc.Node("client", transport="memory", token="c", observer=self.tracing)
        await self.server.start()
        await self.client.start()
        return self

    async def __aexit__(self, *_):
        await self.client.destroy()
        await self.server.destroy()

    def offer(self, callback, name="work", **options):
        self.server.create_service(Add, name, callback, **options)
        return self.client.create_client(Add, name)

    def spans(self, kind):
        return [each for each in self.exporter.get_finished_spans() if each.kind is kind]


@pytest.fixture
async def lab():
    async with Lab() as made:
        yield made


def refuse(request, response):
    raise taskrpc.HandlerError("NOT_FOUND", "no")


@pytest.mark.parametrize(
    ("callback", "code", "status"),
    [(add, "OK", StatusCode.UNSET), (refuse, "NOT_FOUND", StatusCode.ERROR)],
)
async def test_both_sides_write_a_span_with_the_outcome(lab, callback, code, status):
    await asyncio.wait([lab.offer(callback).call_async(ask())])
    await asyncio.sleep(1)
    for kind in (SpanKind.SERVER, SpanKind.CLIENT):
        (span,) = lab.spans(kind)
        assert span.name == "/work"
        assert span.attributes["rpc.response.status_code"] == code
        assert span.status.status_code is status
    (server,) = lab.spans(SpanKind.SERVER)
    assert server.attributes["taskrpc.caller"] == "/client"
    assert server.attributes["taskrpc.call"] >= 1
    assert not lab.tracing._open


async def test_a_span_of_the_client_lies_below_the_current_one_and_took_as_long_as_the_call(lab):
    async def slow(request, response):
        await asyncio.sleep(2)
        return response

    client = lab.offer(slow)
    with trace.get_tracer("mine", tracer_provider=lab.provider).start_as_current_span("mine"):
        await client.call(ask())
    (span,) = lab.spans(SpanKind.CLIENT)
    (mine,) = lab.spans(SpanKind.INTERNAL)
    assert span.parent.span_id == mine.context.span_id
    assert span.end_time - span.start_time == pytest.approx(2e9, rel=0.05)


@pytest.mark.parametrize("threaded", [False, True])
async def test_spans_of_a_callback_are_children_of_its_calls_span(lab, threaded):
    tracer = trace.get_tracer("mine", tracer_provider=lab.provider)

    def traced(request, response):
        with lab.tracing.in_call(), tracer.start_as_current_span("mine"):
            return add(request, response)

    await lab.offer(traced, threaded=threaded).call(ask())
    (server,) = lab.spans(SpanKind.SERVER)
    (mine,) = lab.spans(SpanKind.INTERNAL)
    assert mine.parent.span_id == server.context.span_id
    assert mine.start_time >= server.start_time


async def test_a_servers_span_lies_below_its_callers(lab):
    tracer = trace.get_tracer("mine", tracer_provider=lab.provider)
    inner = lab.offer(add, "inner")

    async def outer(request, response):
        with lab.tracing.in_call():
            return await inner.call(request)

    with tracer.start_as_current_span("mine"):
        assert (await lab.offer(outer).call(ask(2, 3))).sum == 5
    (mine,) = lab.spans(SpanKind.INTERNAL)
    servers = {each.name: each for each in lab.spans(SpanKind.SERVER)}
    clients = {each.name: each for each in lab.spans(SpanKind.CLIENT)}
    way = [mine, clients["/work"], servers["/work"], clients["/inner"], servers["/inner"]]
    assert {each.context.trace_id for each in way} == {mine.context.trace_id}
    assert [each.parent.span_id for each in way[1:]] == [each.context.span_id for each in way[:-1]]
    assert servers["/work"].parent.is_remote


@pytest.mark.parametrize("told", [bytes(25), b"t" * 16 + bytes(9)])
async def test_invalid_span_of_the_caller_starts_a_new_trace(lab, told):
    client = lab.offer(add)
    client._channel.span_of = lambda: told
    await client.call(ask())
    (server,) = lab.spans(SpanKind.SERVER)
    assert server.parent is None
    assert server.context.is_valid


async def test_an_exactly_once_service_has_its_span_too(lab):
    def traced(request, response):
        with lab.tracing.in_call() as span:
            assert span.is_recording()
            return add(request, response)

    client = lab.offer(traced, exactly_once=taskrpc.MemoryCompletions())
    assert (await client.call(ask(2, 3))).sum == 5
    assert len(lab.spans(SpanKind.SERVER)) == 1


async def test_outside_a_callback_there_is_no_span(lab):
    with pytest.raises(LookupError):
        lab.tracing.in_call()
