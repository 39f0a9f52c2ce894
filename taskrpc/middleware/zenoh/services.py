"""Native services over Zenoh: queryables and queriers, as rmw_zenoh has them."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from typing import Any

import zenoh

import srvgen
from taskrpc.errors import Code, HandlerFailed, InvalidRequest, OutcomeUnknown, TaskRpcError
from taskrpc.middleware.zenoh import attachment
from taskrpc.middleware.zenoh.attachment import Attachment
from taskrpc.middleware.zenoh.session import handler, reason_of
from taskrpc.spi import Handoff, NativeReply, OnDone, ServiceType, cdr

log = logging.getLogger("taskrpc.transport")

NO_LIMIT = 1e6
"""Seconds that Zenoh waits for a response. The caller's own deadline ends the call earlier."""
_ERROR_SIZE = 1000
"""The most characters of a server's error that the caller gets."""


class NativeServer:
    """A service of this program that foreign programs can call."""

    def __init__(
        self,
        session: zenoh.Session,
        handoff: Handoff,
        key: str,
        token: str,
        srv_type: ServiceType,
        serve: Callable[[Any, NativeReply], None],
    ) -> None:
        self._key = key
        self._request_type = srv_type.Request
        self._serve = serve
        arrived = handler(handoff, self._arrived)
        self._queryable = session.declare_queryable(key, arrived, complete=True)
        # After the queryable: a caller that sees the token can reach the service.
        self._token = session.liveliness().declare_token(token)

    def close(self) -> None:
        """Withdraw the service; requests that have arrived are still answered."""
        self._token.undeclare()
        self._queryable.undeclare()

    def _arrived(self, query: zenoh.Query) -> None:
        data, sent = query.payload, query.attachment
        attached = attachment.parse(sent.to_bytes()) if sent is not None else None
        if attached is None:
            refuse(query, "expected an attachment of 33 bytes, as rmw_zenoh sends it")
            return
        try:
            body = b"" if data is None else data.to_bytes()
            request = cdr.decode(self._request_type, body)
        except InvalidRequest as error:
            refuse(query, f"the request is not valid: {error}")
            return
        self._serve(request, Reply(query, self._key, attached))


def refuse(query: zenoh.Query, reason: str) -> None:
    """Send an error in place of a response."""
    try:
        with query:
            query.reply_err(reason.encode(errors="replace"))
    except zenoh.ZError as error:
        log.debug("an error for a native caller was not sent: %s", reason_of(error))


class Reply:
    """Sends the response or the error to a foreign caller."""

    caller = ""

    def __init__(self, query: zenoh.Query, key: str, attached: Attachment) -> None:
        self._query = query
        self._key = key
        self._request = attached

    def reply(self, response: Any) -> None:
        """Send the response message."""
        try:
            data = srvgen.to_cdr(response)
        except (ValueError, TypeError) as error:
            refuse(self._query, f"the response is not valid: {error}")
            raise InvalidRequest("", str(error)) from None
        request = self._request
        about = attachment.pack(request.sequence, time.time_ns(), request.gid)
        try:
            with self._query as query:
                query.reply(self._key, data, attachment=about, express=True)
        except zenoh.ZError as error:
            log.warning("a response to a native caller was not sent: %s", reason_of(error))

    def fail(self, error: TaskRpcError) -> None:
        """Send the error as text. The clients of rmw_zenoh log it, and continue to wait."""
        refuse(self._query, f"{type(error).__name__}: {error}")


class NativeClient:
    """Calls one service of foreign programs."""

    def __init__(self, session: zenoh.Session, handoff: Handoff, key: str, service: str) -> None:
        self.service = service
        self._handoff = handoff
        self._gid = os.urandom(attachment.GID_SIZE)
        self._sent = 0
        self._querier = session.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=NO_LIMIT,
            express=True,
        )

    def call(self, srv_type: ServiceType, request: Any, on_done: OnDone) -> NativeCall:
        """Send a request. Raises InvalidRequest."""
        data = cdr.encode(srv_type.Request, request)
        self._sent += 1
        about = attachment.pack(self._sent, time.time_ns(), self._gid)
        call = NativeCall(self.service, srv_type, on_done)
        replied = handler(self._handoff, call.replied, call.over)
        self._querier.get(replied, payload=data, attachment=about)
        return call

    def close(self) -> None:
        """Send no more requests."""
        self._querier.undeclare()


class NativeCall:
    """A call without a response so far."""

    def __init__(self, service: str, srv_type: ServiceType, on_done: OnDone) -> None:
        self._service = service
        self._response_type = srv_type.Response
        self._on_done: OnDone | None = on_done

    def cancel(self) -> None:
        """Forget the call."""
        self._on_done = None

    def replied(self, reply: zenoh.Reply) -> None:
        """Handle a response, or the error that a server sent instead."""
        if self._on_done is None:
            return  # cancelled, or a second server has responded too
        if (sample := reply.ok) is not None:
            try:
                response = cdr.decode(self._response_type, sample.payload.to_bytes())
            except InvalidRequest as error:
                text = f"the response of {self._service} is not valid: {error}"
                self._end(None, HandlerFailed(Code.INTERNAL, text))
            else:
                self._end(response, None)
        elif (failure := reply.err) is not None:
            text = failure.payload.to_bytes().decode(errors="replace")[:_ERROR_SIZE]
            self._end(None, HandlerFailed(Code.INTERNAL, f"{self._service} failed: {text}"))

    def over(self) -> None:
        """Handle the end of all responses: every server has responded, or has gone."""
        problem = f"the server of {self._service} ended the call without a response"
        self._end(None, OutcomeUnknown(problem))

    def _end(self, response: Any, error: TaskRpcError | None) -> None:
        on_done, self._on_done = self._on_done, None
        if on_done is not None:
            on_done(response, error)
