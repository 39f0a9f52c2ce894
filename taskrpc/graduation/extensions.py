"""What only taskrpc has: its own modules, arguments that rclpy does not know, `--json`."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from taskrpc.graduation.program import Finding, Program, at, called, imports, receiver

_ENTITY = "callback_group event_callbacks qos_overriding_options"
_ARGUMENTS = {
    name: frozenset(known.split())
    for name, known in {
        "call": "request timeout_sec",
        "call_async": "request",
        "create_client": "srv_type srv_name qos_profile callback_group",
        "create_publisher": f"msg_type topic qos_profile publisher_class {_ENTITY}",
        "create_service": "srv_type srv_name callback qos_profile callback_group",
        "create_subscription": (
            f"msg_type topic callback qos_profile raw content_filter_options {_ENTITY}"
        ),
        "create_timer": "timer_period_sec callback callback_group clock autostart",
        "wait_for_service": "timeout_sec",
    }.items()
}
_FIXES = {
    "exactly_once": "make the service idempotent, or let the request name itself in a field",
    "idempotent": "leave it out",
    "request_id": "put an id into the request, for the server to know it again",
    "retry": "repeat only what is idempotent: ROS 2 may have run a request that was not answered",
    "timeout": "leave it out, and give spin_until_future_complete a timeout_sec",
}


def extensions(program: Program) -> Iterator[Finding]:
    """All of these in a program."""
    told: set[ast.stmt] = set()
    for name, statement in imports(program.tree):
        if name.partition(".")[0] in ("taskrpc", "srvgen") and statement not in told:
            told.add(statement)
            yield at(
                statement,
                f"{name} is imported",
                "ROS 2 does not have it: ModuleNotFoundError",
                "write it with rclpy and the interface packages",
            )
    if program.imports_rclpy:
        for call in program.calls:
            yield from _arguments(program, call)
    yield from _json(program)


def _arguments(program: Program, call: ast.Call) -> Iterator[Finding]:
    name = called(call)
    known = _ARGUMENTS.get(name)
    if known is None or (name.startswith("call") and receiver(call) not in program.clients):
        return
    for each in call.keywords:
        if each.arg is not None and each.arg not in known:
            yield at(
                each,
                f"{name}({each.arg}=...)",
                "rclpy does not know the argument: TypeError",
                _FIXES.get(each.arg, "leave it out"),
            )


def _json(program: Program) -> Iterator[Finding]:
    for node in ast.walk(program.tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            words = node.value.split()
            if words == ["--json"] or {"ros2", "--json"} <= set(words):
                yield at(
                    node,
                    "--json",
                    "ros2's commands do not know it",
                    "read their YAML, or ask with rclpy",
                )
