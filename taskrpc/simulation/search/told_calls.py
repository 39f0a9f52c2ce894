"""The calls of a run with their requests and responses, as the events of ROS recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import srvgen
from srvgen.classes.loader import search
from taskrpc.observe.recording.schemas import EVENT, schema_text
from taskrpc.simulation.interpreter.loop import FIRST_DAY
from taskrpc.simulation.search.protocol import Contents, ServiceEvent, ServiceType, ToldCall
from taskrpc.spi import gid_of, service_event

if TYPE_CHECKING:
    from taskrpc.simulation.run.contents import Step
    from taskrpc.simulation.run.run import Run
    from taskrpc.simulation.run.world import CallRecord

_OF_CHECKS: Final = "check"
"""The client of the calls that the scenario's checks make."""


def contents_of(run: Run) -> Contents:
    """Return the calls of a run that has ended and kept their contents."""
    assert run.contents is not None
    steps: dict[int, list[Step]] = {}
    for step in run.contents.steps:
        steps.setdefault(step.call, []).append(step)
    calls, events = [], _Events()
    for number, call in enumerate(run.calls, 1):
        if not call.is_hidden:
            of_call = steps.get(number, [])
            calls.append(_told(number, call, of_call))
            events.add(number, call, of_call)
    events.events.sort(key=lambda event: event.time)
    types = {service: each[1] for service, each in events.types.items() if each is not None}
    return Contents(calls, types, events.events)


def _told(number: int, call: CallRecord, steps: list[Step]) -> ToldCall:
    ended = None if call.ok is None else call.ended
    deadline = steps[-1].deadline if steps else None
    if call.code == "DEADLINE_EXCEEDED":
        deadline = ended  # also if the request has not arrived, or was repeated
    client, code = call.program or _OF_CHECKS, call.code or "OK"
    return ToldCall(number, client, call.service, call.began, ended, code, deadline)


class _Events:
    """Makes the events of the calls."""

    def __init__(self) -> None:
        self.events: list[ServiceEvent] = []
        self.types: dict[str, tuple[Any, ServiceType] | None] = {}
        """The class and the type of each service; None if its definition is missing."""

    def add(self, number: int, call: CallRecord, steps: list[Step]) -> None:
        """Add the events of one call: those of the client, and those of the service."""
        requests = [each for each in steps if each.name == "REQUEST_RECEIVED"]
        responses = [each for each in steps if each.name == "RESPONSE_SENT"]
        if requests:  # one that never arrived is not known
            self._add(number, call, requests[0], "REQUEST_SENT", call.began)
        for step in steps:
            self._add(number, call, step, step.name, step.time)
        if call.ok and responses:
            self._add(number, call, responses[-1], "RESPONSE_RECEIVED", call.ended)

    def _add(self, number: int, call: CallRecord, step: Step, name: str, time: float) -> None:
        if call.service not in self.types:
            self.types[call.service] = _type_of(step.cls)
        found = self.types[call.service]
        if found is None:
            return
        srv_type, _ = found
        section = "request" if name.startswith("REQUEST") else "response"
        message = {section: srvgen.from_cdr(step.cls, step.data)}
        gid, stamp = gid_of(call.process or call.program), int((FIRST_DAY + time) * 1e9)
        event = service_event(srv_type, name, stamp, gid, number, **message)
        self.events.append(ServiceEvent(time, call.service, number, srvgen.to_cdr(event)))


def _type_of(cls: Any) -> tuple[Any, ServiceType] | None:
    name = cls._TYPE.rpartition("_")[0]
    try:
        srv_type: Any = srvgen.load(name)
        schema = schema_text(f"{name}{EVENT}", search())
    except srvgen.DefinitionError:
        return None
    return srv_type, ServiceType(f"{name}{EVENT}", schema, srv_type.Event._HASH)
