"""Permissions: which client calls the task server, and what it may do to which tasks.

All of it is separate from the services, so that a security review finds it in one place.
"""

from __future__ import annotations

from taskrpc import Role, current_call
from taskrpc.robot.tasks.model import Task
from taskrpc.spi import Denied

ROLES = {
    "estimate": Role.OBSERVE,
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
"""The role that each service below `/robot_task` requires at least."""


def client_name() -> str:
    """Return the name of the running call's client: its account, otherwise its node."""
    return submitter()[0]


def submitter() -> tuple[str, str, str]:
    """Return the running call's client name, account and machine.

    The account is "" for a client that has the server's own token. The machine is an address, ""
    for this machine. All three are "" outside a call.
    """
    try:
        call = current_call()
    except LookupError:  # a method of `TaskServer` was called directly
        return "", "", ""
    return call.principal or call.caller, call.principal, call.machine


def refuse_others_task(task: Task | None) -> None:
    """Refuse a task that another client submitted, unless the caller has the role OPERATE.

    Raises:
        Denied: the caller may not change this task.
    """
    try:
        call = current_call()
    except LookupError:
        return
    if task is None or call.role >= Role.OPERATE or task.client == call.principal:
        return
    raise Denied(
        f"task {task.task_id} was submitted by another client: to change it, the account"
        f" {call.principal} needs the role operate, but it has {call.role.name.lower()}",
    )
