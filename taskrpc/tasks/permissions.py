"""Who asks the task server, and what he may do to whose tasks."""

from __future__ import annotations

from taskrpc.callinfo import Denied, current_call
from taskrpc.security.roles import Role
from taskrpc.tasks.model import Task

ROLES = {
    "list": Role.OBSERVE,
    "show": Role.OBSERVE,
    "watch": Role.OBSERVE,
    "health": Role.OBSERVE,
    "cancel": Role.SUBMIT,
    "drop": Role.SUBMIT,
    "pause": Role.OPERATE,
    "resume": Role.OPERATE,
    "reprioritise": Role.OPERATE,
    "requeue": Role.OPERATE,
    "stop": Role.OPERATE,
}
"""The least role for each service below `/robot_task`."""


def client_name() -> str:
    """Whose task the running call submits: the account's, else the calling node's."""
    return submitter()[0]


def submitter() -> tuple[str, str, str]:
    """The same; the call's account, "" for whoever has the server's own token; and its machine.

    The last is an address, "" for this one.
    """
    try:
        call = current_call()
    except LookupError:  # called without a network
        return "", "", ""
    return call.principal or call.caller, call.principal, call.machine


def refuse_others_task(task: Task | None) -> None:
    """Let nobody below OPERATE touch what another client has submitted.

    Raises Denied.
    """
    try:
        call = current_call()
    except LookupError:
        return
    if task is None or call.role >= Role.OPERATE or task.client == call.principal:
        return
    raise Denied(
        f"task {task.task_id} is not the account {call.principal}'s: what others submitted needs"
        f" the role operate; the account has {call.role.name.lower()}",
    )
