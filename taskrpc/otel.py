"""Spans for OpenTelemetry: one for each call that a node answers, one for each that it makes.

Needs the extra `otel`. A call carries no trace context on the wire, so a server's span begins a
trace of its own: what is linked is what happens within one program.
"""

from __future__ import annotations

import time
from contextlib import AbstractContextManager

from opentelemetry import trace
from opentelemetry.util.types import AttributeValue

from taskrpc.callinfo import CallInfo, current_call
from taskrpc.errors import Code
from taskrpc.observer import Observer


class Tracing(Observer):
    """An observer that makes spans: `Node(observer=Tracing())`.

    It takes the tracer of `provider`, by default the one that the program has set.
    """

    def __init__(self, provider: trace.TracerProvider | None = None) -> None:
        self._tracer = trace.get_tracer("taskrpc", tracer_provider=provider)
        self._open: dict[tuple[str, int], trace.Span] = {}

    def in_call(self) -> AbstractContextManager[trace.Span]:
        """Makes the running call's span the current one: `with tracing.in_call():`.

        What the callback does in this block, spans of its own and calls to others, is below it.

        Raises LookupError outside a callback of a node that has this observer.
        """
        call = current_call()
        return trace.use_span(self._open[call.service, call.number])

    # What an observer is told

    def call_began(self, call: CallInfo) -> None:
        """A call arrived: its span begins."""
        attributes: dict[str, AttributeValue] = {
            "taskrpc.call": call.number,
            "taskrpc.caller": call.caller,
        }
        span = self._span(call.service, trace.SpanKind.SERVER, attributes, None)
        self._open[call.service, call.number] = span

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call has its answer: its span ends."""
        span = self._open.pop((call.service, call.number), None)
        if span is not None:  # None where the request could not be decoded
            _end(span, code)

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """A client has made a call: its span, below the current one, is written afterwards."""
        began = time.time_ns() - int(seconds * 1e9)
        _end(self._span(service, trace.SpanKind.CLIENT, {}, began), code)

    def _span(
        self,
        service: str,
        kind: trace.SpanKind,
        more: dict[str, AttributeValue],
        began: int | None,
    ) -> trace.Span:
        attributes = {"rpc.system": "taskrpc", "rpc.service": service, **more}
        return self._tracer.start_span(service, kind=kind, attributes=attributes, start_time=began)


def _end(span: trace.Span, code: Code) -> None:
    span.set_attribute("rpc.response.status_code", code.name)
    if code is not Code.OK:
        span.set_status(trace.StatusCode.ERROR, code.name)
    span.end()
