"""Spans for OpenTelemetry: one for each call that a node serves, and one for each that it makes.

Needs the extra `otel`. If both sides have such an observer, the request carries the caller's span,
and the server's span is its child.
"""

from __future__ import annotations

import time
from contextlib import AbstractContextManager

from opentelemetry import trace
from opentelemetry.context import Context
from opentelemetry.util.types import AttributeValue

from taskrpc import CallInfo, Observer, current_call
from taskrpc.errors import Code
from taskrpc.spi import Outgoing


class Tracing(Observer):
    """An observer that makes spans: `Node(observer=Tracing())`.

    It uses the tracer of `provider`; by default that of the program's own provider.
    """

    def __init__(self, provider: trace.TracerProvider | None = None) -> None:
        self._tracer = trace.get_tracer("taskrpc", tracer_provider=provider)
        self._open: dict[tuple[str, int], trace.Span] = {}
        """The spans of running calls, by service and number."""

    def in_call(self) -> AbstractContextManager[trace.Span]:
        """Make the running call's span the current one: `with tracing.in_call():`.

        Spans that the callback starts in this block, and its own calls, become children of it.

        Raises LookupError outside a callback of a node that has this observer.
        """
        call = current_call()
        return trace.use_span(self._open[call.service, call.number])

    # The methods of an observer

    def call_began(self, call: CallInfo) -> None:
        """Start the span of a call that arrived."""
        attributes: dict[str, AttributeValue] = {
            "taskrpc.call": call.number,
            "taskrpc.caller": call.caller,
        }
        span = self._span(call.service, trace.SpanKind.SERVER, attributes, _caller(call.span))
        self._open[call.service, call.number] = span

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """End the span of a call that has ended."""
        span = self._open.pop((call.service, call.number), None)
        if span is not None:  # None if the request could not be decoded
            _end(span, code)

    def request_began(self, service: str) -> Outgoing:
        """Start the span of a client's call, as a child of the current span."""
        now = time.time_ns()
        return _Sent(self._span(service, trace.SpanKind.CLIENT, {}, None, now), now)

    def _span(
        self,
        service: str,
        kind: trace.SpanKind,
        more: dict[str, AttributeValue],
        parent: Context | None,
        began: int | None = None,
    ) -> trace.Span:
        attributes = {"rpc.system": "taskrpc", "rpc.service": service, **more}
        return self._tracer.start_span(
            service, parent, kind=kind, attributes=attributes, start_time=began
        )


class _Sent:
    """The span of a call that a client makes."""

    def __init__(self, span: trace.Span, began: int) -> None:
        self._span = span
        self._began = began
        context = span.get_span_context()
        self.span = b""
        if context.is_valid:
            trace_id, span_id = context.trace_id.to_bytes(16), context.span_id.to_bytes(8)
            self.span = trace_id + span_id + bytes([context.trace_flags])

    def ended(self, code: Code, seconds: float) -> None:
        _end(self._span, code, self._began + int(seconds * 1e9))


def _caller(span: bytes) -> Context | None:
    """Return the context with the caller's span as parent; None if the caller sent no span."""
    if not span:
        return None
    parent = trace.SpanContext(
        int.from_bytes(span[:16]),
        int.from_bytes(span[16:24]),
        is_remote=True,
        trace_flags=trace.TraceFlags(span[24]),
    )
    return trace.set_span_in_context(trace.NonRecordingSpan(parent), Context())


def _end(span: trace.Span, code: Code, at: int | None = None) -> None:
    span.set_attribute("rpc.response.status_code", code.name)
    if code is not Code.OK:
        span.set_status(trace.StatusCode.ERROR, code.name)
    span.end(at)
