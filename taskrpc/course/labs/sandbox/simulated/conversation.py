"""The checks' end of a simulation: it answers the requests, and collects what is reported."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

import srvgen
from taskrpc.course.labs.sandbox.simulated.messages import (
    Answered,
    Asked,
    Ended,
    MessageType,
    Offered,
    Plan,
    Planned,
    Reply,
    Told,
)
from taskrpc.course.labs.trial import Call, Response, Service, Simulated

_decode = msgspec.json.Decoder(Told).decode


class Conversation:
    """What the checks and one simulating process say to each other.

    Args:
        duration: virtual seconds after which the run ends at the latest.
        service: what the checks offer.
        calls: what the checks call.
    """

    def __init__(self, duration: float, service: Service | None, calls: Sequence[Call]) -> None:
        self.ended: Ended | None = None
        """The report; None if there was none."""
        self.error: Exception | None = None
        """What a message or its answer has raised; the messages after it are not read."""
        self.send: Callable[[bytes], None]
        """Sends to the process; set before its first message."""
        self._service = service
        self._calls = calls
        self._responses = [Response(math.inf, math.inf, None, "") for _ in calls]
        self._type: Any = None
        offered = None
        if service is not None:
            self._type = srvgen.define(service.type_name, service.definition)
            offered = Offered(MessageType(service.type_name, service.definition), service.name)
        planned = tuple(
            Planned(MessageType(each.type_name), each.name, _cdr(each.request), each.at)
            for each in calls
        )
        self.plan = Plan(duration, offered, planned)

    def received(self, line: bytes) -> None:
        """Handle a message, which the submission may have made up."""
        if self.error is not None or self.ended is not None:
            return
        try:
            match _decode(line):
                case Asked() as asked:
                    self._reply(asked)
                case Answered() as answered:
                    self._note(answered)
                case Ended() as ended:
                    self.ended = ended
        except Exception as error:
            self.error = error

    def result(self) -> Simulated:
        """Return how the program ran, once the process has reported its end."""
        assert self.ended is not None
        return Simulated(
            [each.text for each in self.ended.lines],
            [each.time for each in self.ended.lines],
            self.ended.code,
            self._responses,
            self.ended.problem,
        )

    def _reply(self, asked: Asked) -> None:
        if self._service is None:
            raise ValueError("a request arrived, but the check offers no service")
        request = srvgen.from_cdr(self._type.Request, asked.request)
        response = self._service.respond(request, asked.time)
        data = None if response is None else _cdr(response)
        self.send(msgspec.json.encode(Reply(data)) + b"\n")

    def _note(self, answered: Answered) -> None:
        srv_type: Any = srvgen.load(self._calls[answered.call].type_name)
        message = None
        if answered.response is not None:
            message = srvgen.from_cdr(srv_type.Response, answered.response)
        self._responses[answered.call] = Response(
            answered.began, answered.time, message, answered.problem
        )


def _cdr(message: Any) -> bytes:
    return srvgen.to_cdr(message)
