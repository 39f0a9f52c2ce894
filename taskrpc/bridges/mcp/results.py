"""What an agent is told: responses as JSON, and errors with what to do next. Pure."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import msgspec

from srvgen import DefinitionError, FieldError
from taskrpc.bridges.mcp.arguments import DRY_RUN, REQUEST_ID
from taskrpc.bridges.mcp.permissions import Refused
from taskrpc.bridges.rosbridge.values import to_json
from taskrpc.errors import (
    GoalFailed,
    InvalidRequest,
    RequestIdReused,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.message_types import Msg

Executed: TypeAlias = Literal["no", "yes", "unknown"]


class Result(msgspec.Struct, frozen=True):
    """The result of one call of a tool: the same as text and as JSON."""

    text: str
    json: dict[str, object]
    is_error: bool = False


class UnknownTool(TaskRpcError):
    """The network has no service or action for a tool of this name, or the agent may not see it."""

    not_executed = True


EXPLAINED = (TaskRpcError, FieldError, DefinitionError)
"""Errors whose text tells the agent what is wrong."""


def json_of(message: Msg) -> dict[str, object]:
    """Return a message as JSON has it: NaN and infinities are null."""
    found: dict[str, object] = msgspec.json.decode(msgspec.json.encode(to_json(message)))
    return found


def response(message: Msg) -> Result:
    """Return the result of a call or of a goal that succeeded."""
    return _result(json_of(message))


def dry_run(target: str, message: Msg, estimate: Msg | None = None) -> Result:
    """Return the result of a call that was only checked; `estimate` is that of a task server.

    It is an error for the client, because it does not have the fields of a response.
    """
    described: dict[str, object] = {
        "error": "DryRun",
        "message": f"nothing was sent to {target}; the arguments are valid and permitted",
        "executed": "no",
        "advice": f"Leave out {DRY_RUN} to carry out the call.",
        "request": json_of(message),
    }
    if estimate is not None:
        described["estimate"] = json_of(estimate)
    return _failed(described)


def failure(error: Exception, request_id: str = "") -> Result:
    """Return the result of a call that failed.

    `request_id` is the id with which the agent may repeat the call; "" if it must not.
    """
    if not isinstance(error, EXPLAINED):
        text = "the bridge failed to carry out the call; its log has the reason"
        return _failed({"error": "InternalError", "message": text, "executed": "unknown"})
    executed = _executed(error)
    described: dict[str, object] = {
        "error": "InvalidRequest" if isinstance(error, FieldError) else type(error).__name__,
        "message": str(error),
        "executed": executed,
        "advice": _advice(error, executed, request_id),
    }
    if isinstance(error, FieldError | InvalidRequest) and error.path:
        described["field"] = error.path
    if (wait := getattr(error, "retry_after", 0.0)) > 0:
        described["retry_after"] = wait
    if isinstance(error, GoalFailed) and error.result is not None:
        described["result"] = json_of(error.result)
    return _failed(described)


def _executed(error: Exception) -> Executed:
    if not isinstance(error, TaskRpcError) or error.not_executed:
        return "no"
    return "unknown" if error.not_executed is None else "yes"


def _advice(error: Exception, executed: Executed, request_id: str) -> str:
    match error:
        case UnknownTool() | ServiceUnavailable() | TypeMismatch():
            text = "List the tools again: the programs of the network have changed."
        case FieldError() | InvalidRequest():
            text = "Correct the arguments; the input schema of the tool says what they may be."
        case Refused(retry_after=seconds) | ServerBusy(retry_after=seconds) if seconds > 0:
            text = f"Try again in {seconds:.1f} s."
        case Refused():
            text = "Do not repeat the call; ask the user for permission, or use other values."
        case RequestIdReused():
            text = f"Give each new request a new {REQUEST_ID}."
        case _:
            text = _advice_after(executed, request_id)
    return text


def _advice_after(executed: Executed, request_id: str) -> str:
    if executed != "unknown":
        return "The call has run." if executed == "yes" else "The call has not run."
    if request_id:
        same = f'the same arguments and {REQUEST_ID} "{request_id}"'
        return f"Repeat the call with {same}: it runs once."
    return "Find out whether the call ran before you repeat it."


def _failed(described: dict[str, object]) -> Result:
    advice = described.get("advice", "")
    text = f"{described['error']}: {described['message']}"
    return Result(f"{text}\n{advice}".strip(), described, is_error=True)


def _result(value: dict[str, Any]) -> Result:
    return Result(msgspec.json.encode(value).decode(), value)
