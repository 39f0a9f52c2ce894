"""Connects the nodes of a run with its trace and its faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc import Observer
from taskrpc.errors import Code
from taskrpc.simulation.run.contents import Contents, span_of
from taskrpc.simulation.run.trace import Trace
from taskrpc.simulation.run.world import CallRecord
from taskrpc.spi import Fault, names
from taskrpc.testing import CallFaults
from taskrpc.topic import Publisher

if TYPE_CHECKING:
    from taskrpc import CallInfo, Msg
    from taskrpc.simulation.interpreter.programs import Process
    from taskrpc.simulation.run.trace import Kind

_HIDDEN = ("/_", "/rosout", "/parameter_events")
"""Services and topics that programs do not use themselves."""
_OF_ACTIONS = "/_action/status"
"""The topic on which taskrpc and rclpy tell the states of goals."""


class Noting(Protocol):
    """The run whose nodes are observed."""

    calls: list[CallRecord]
    trace: Trace
    contents: Contents | None

    @property
    def now(self) -> float:
        """Virtual seconds since the begin."""

    def present(self) -> Process | None:
        """Return the process that runs now."""

    def where(self, process: Process) -> str:
        """Return the line of the program that is being run."""

    def line_of_call(self, process: Process, service: str) -> str:
        """Return the line of the program that makes a call which begins now."""

    def asks(self, service: str) -> None:
        """A program makes a call, which its event loop begins later."""

    def note(self, kind: Kind, text: str, program: str = "", where: str = "") -> None:
        """Add an event."""

    def seen(self, process: Process) -> None:
        """Count what a program did."""

    def published(self, topic: str, message: object, subscriptions: int) -> None:
        """A program publishes a message, which so many subscriptions get."""

    def fault(self, name: str, program: str) -> None:
        """A fault has happened."""

    def fault_of_call(self, service: str, count: int) -> Fault | None:
        """Return the fault of a call, the `count`th that arrived at a service."""


class RunObserver(Observer):
    """Notes the calls of all nodes."""

    def __init__(self, run: Noting) -> None:
        self._run = run

    def request_began(self, service: str) -> _Outgoing:
        """A program makes a call."""
        return _Outgoing(self._run, service)

    def call_began(self, call: CallInfo) -> None:
        """A call has arrived."""
        if (process := self._run.present()) is not None and not is_hidden(call.service):
            self._run.note("begin", call.service, process.name)
            self._run.seen(process)
        if self._run.contents is not None:
            self._run.contents.keep("REQUEST_RECEIVED", call, getattr(call, "request", None))

    def call_answered(self, call: CallInfo, response: Msg) -> None:
        """A call gets its response."""
        if self._run.contents is not None:
            self._run.contents.keep("RESPONSE_SENT", call, response)

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call has ended; one that its caller no longer waits for is cancelled."""
        if code not in (Code.CANCELLED, Code.DEADLINE_EXCEEDED) or is_hidden(call.service):
            return
        if getattr(call, "is_answered", False):  # and the response was lost
            return
        if (process := self._run.present()) is not None:
            self._run.note("cancel", call.service, process.name)
            self._run.seen(process)


class _Outgoing:
    """One call of a program."""

    def __init__(self, run: Noting, service: str) -> None:
        self._run = run
        self._process = run.present()
        name, process, where, hidden = "", "", "", is_hidden(service)
        if self._process is not None:
            name, process = self._process.name, self._process.id
            where = run.line_of_call(self._process, service)
            if not hidden:
                run.note("call", service, name, where)
                run.seen(self._process)
        count = len(run.trace.events)
        self._record = CallRecord(name, process, service, run.now, count, where, hidden)
        run.calls.append(self._record)
        self.span = b"" if run.contents is None else span_of(len(run.calls))

    def ended(self, code: Code, seconds: float) -> None:
        self._record.ok = code is Code.OK
        self._record.code, self._record.ended = code.name, self._run.now
        if self._process is not None and not self._record.is_hidden:
            kind, text = ("answer", "") if self._record.ok else ("error", f" {code.name}")
            self._run.note(kind, f"{self._record.service}{text}", self._process.name)  # type: ignore[arg-type]
            self._run.seen(self._process)


def watch_publishers(present: Callable[[], Noting | None]) -> None:
    """Note the messages of all publishers from now on."""
    publish = Publisher.publish

    def noted(publisher: Publisher[Any], message: Any) -> None:
        if (run := present()) is not None:
            count = publisher.get_subscription_count()
            run.published(publisher.topic_name, message, count)
        publish(publisher, message)

    Publisher.publish = noted  # type: ignore[assignment, method-assign]


def watch_callers(present: Callable[[], Noting | None]) -> None:
    """Note which lines of rclpy programs make calls: the loop's thread sends them later."""
    from rclpy.client import Client

    call_async = Client.call_async

    def noted(client: Client[Any, Any], request: Any) -> Any:
        if (run := present()) is not None:
            run.asks(client.service_name)
        return call_async(client, request)

    Client.call_async = noted  # type: ignore[assignment, method-assign]


class RunFaults(CallFaults):
    """Loses requests and responses as the choices of a run say."""

    def __init__(self, run: Noting) -> None:
        super().__init__()
        self.plan = _Plan(run)
        self._run = run

    def report(self, call: object, fault: Fault) -> None:
        """Note a fault of a call in the trace."""
        if isinstance(fault, NamedFault):
            self._run.fault(fault.name, fault.program)


class NamedFault(Fault, frozen=True, kw_only=True):
    """A fault of a call, with its name in the choices."""

    name: str
    program: str
    """The program that the call reached."""


class _Plan:
    def __init__(self, run: Noting) -> None:
        self._run = run
        self._counts: dict[str, int] = {}

    def concerns(self, service: str) -> bool:
        return not is_hidden(service)

    def next(self, service: str) -> Fault | None:
        count = self._counts[service] = self._counts.get(service, 0) + 1
        return self._run.fault_of_call(service, count)


def is_hidden(service: str) -> bool:
    """Whether a service or topic is one that taskrpc or rclpy makes by itself."""
    is_own = service.startswith(_HIDDEN) or service.endswith(_OF_ACTIONS)
    return is_own or names.is_of_every_node(service)
