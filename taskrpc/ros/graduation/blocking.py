"""Programs that wait for ever on ROS 2: blocking calls in callbacks, and responses that never come.

A callback that waits for a response blocks the thread that would receive it. A response never comes
if nothing spins, if the request was lost, or if the service callback does not return one.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from taskrpc.ros.graduation.program import (
    SPINS,
    Finding,
    Function,
    Program,
    Step,
    argument,
    called,
    finding_at,
    own_nodes,
    receiver,
)

_IN_FLIGHT = 10
"""Requests that ROS 2's default queue keeps for a service."""
_LOST = "the eleventh removes the first from the queue, and the first never gets a response"
_NO_RESPONSE = "the server ends with an error in ROS 2, and the caller waits for ever"


def blocking(program: Program) -> Iterator[Finding]:
    """All places where a program waits for ever, or makes its caller wait for ever."""
    yield from _in_callbacks(program)
    yield from _calls_without_spin(program)
    yield from _futures_without_spin(program)
    yield from _calls_without_wait_for_service(program)
    yield from _too_many_in_flight(program)
    yield from _services_without_response(program)
    yield from _two_servers(program)


# Inside callbacks


def _in_callbacks(program: Program) -> Iterator[Finding]:
    reported: set[ast.Call] = set()
    for step in program.inside:
        if step.call in reported:
            continue
        found = list(_in_callback(program, step))
        if found:
            reported.add(step.call)
        yield from found


def _in_callback(program: Program, step: Step) -> Iterator[Finding]:
    name, way = called(step.call), " > ".join(step.through)
    if name == "call" and _is_client(program, step.call) and not _may_overlap(program):
        yield finding_at(
            step.call,
            f"{receiver(step.call)}.call inside a callback ({way})",
            "ROS 2 hangs: the thread that should receive the response waits for it",
            "use await call_async(...) in an async def callback, or add_done_callback",
        )
    elif name in SPINS:
        yield finding_at(
            step.call,
            f"{name} inside a callback ({way})",
            "ROS 2 hangs, or reports that the executor is already spinning",
            "await the future in an async def callback, or use add_done_callback",
        )
    elif name == "sleep" and receiver(step.call) in ("time", "") and not _is_awaited(program, step):
        yield finding_at(
            step.call,
            f"sleep inside a callback ({way})",
            "ROS 2 runs no other callback of the node during the sleep",
            "use a timer, or a separate callback group and a MultiThreadedExecutor",
        )
    elif name == "sleep" and "rate" in receiver(step.call).lower() and not _may_overlap(program):
        yield finding_at(
            step.call,
            f"{receiver(step.call)}.sleep inside a callback ({way})",
            "ROS 2 hangs: the thread that should end the sleep is asleep",
            "use a timer",
        )


# Without a spin


def _calls_without_spin(program: Program) -> Iterator[Finding]:
    inside = {step.call for step in program.inside}
    if _spins_in_a_thread(program):
        return
    for call in program.made_by("call"):
        if _is_client(program, call) and call not in inside:
            yield finding_at(
                call,
                f"{receiver(call)}.call while no other thread spins",
                "ROS 2 waits for ever",
                "use call_async and rclpy.spin_until_future_complete",
            )


def _futures_without_spin(program: Program) -> Iterator[Finding]:
    yield from _results_without_spin(program)
    spins_in_a_thread = _spins_in_a_thread(program)
    loops = [node for node in ast.walk(program.tree) if isinstance(node, ast.While)]
    for loop in [] if spins_in_a_thread else loops:
        if _waits_without_spin(loop):
            yield finding_at(
                loop,
                "a loop that waits for a future and does not spin",
                "ROS 2 never leaves it",
                "use rclpy.spin_until_future_complete, or spin_once in the loop",
            )
    sent = program.made_by("call_async")
    is_whole_program = bool(program.made_by("init"))
    spins = spins_in_a_thread or any(called(call) in SPINS for call in program.calls)
    if sent and is_whole_program and not spins:
        yield finding_at(
            sent[0],
            "call_async in a program that never spins",
            "ROS 2 never receives the response",
            "use rclpy.spin_until_future_complete",
        )


def _results_without_spin(program: Program) -> Iterator[Finding]:
    for call in program.made_by("result"):
        inner = call.func.value if isinstance(call.func, ast.Attribute) else None
        if isinstance(inner, ast.Call) and called(inner) == "call_async":
            yield finding_at(
                call,
                "result() of a call that was only just sent",
                "it is None in ROS 2, which receives responses only during a spin",
                "use spin_until_future_complete first, or await the future",
            )


def _waits_without_spin(loop: ast.While) -> bool:
    waits = any(
        isinstance(node, ast.Call) and called(node) == "done" for node in ast.walk(loop.test)
    )
    calls = [node for node in ast.walk(loop) if isinstance(node, ast.Call)]
    return waits and not any(called(call) in SPINS for call in calls)


def _spins_in_a_thread(program: Program) -> bool:
    """Whether a thread of the program spins."""
    for call in program.made_by("Thread"):
        if any("spin" in ast.unparse(each) for each in (*call.args, *call.keywords)):
            return True
        target = argument(call, 1, "target")
        if isinstance(target, ast.Name | ast.Attribute) and _is_spinning(program, target):
            return True
    return False


def _is_spinning(program: Program, target: ast.expr) -> bool:
    name = target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", "")
    return any(
        isinstance(node, ast.FunctionDef) and node.name == name and "spin" in ast.unparse(node)
        for node in ast.walk(program.tree)
    )


# Requests that are lost


def _calls_without_wait_for_service(program: Program) -> Iterator[Finding]:
    waited = {
        receiver(call)
        for name in ("wait_for_service", "service_is_ready")
        for call in program.made_by(name)
    }
    for name, made in program.clients.items():
        calls = [
            call
            for call in program.calls
            if called(call) in ("call", "call_async") and receiver(call) == name
        ]
        if calls and name not in waited:
            yield finding_at(
                made,
                f"{name} calls without wait_for_service",
                "ROS 2 loses a request that it sends before it has discovered the server",
                f"wait first: while not {name}.wait_for_service(timeout_sec=1.0): ...",
            )


def _too_many_in_flight(program: Program) -> Iterator[Finding]:
    for call in program.made_by("call_async"):
        loop = next((each for each in program.above(call) if isinstance(each, _Loops)), None)
        if loop is None or _waits_inside(loop) or _repeats_few_times(loop):
            continue
        yield finding_at(
            call,
            "call_async in a loop that does not wait",
            f"ROS 2 keeps {_IN_FLIGHT} requests: {_LOST}",
            f"wait for responses before more than {_IN_FLIGHT} requests are in flight",
        )


_Loops = ast.For | ast.While | ast.ListComp | ast.GeneratorExp | ast.AsyncFor


def _waits_inside(loop: ast.AST) -> bool:
    nodes = list(ast.walk(loop))
    awaits = any(isinstance(node, ast.Await) for node in nodes)
    spins = any(isinstance(node, ast.Call) and called(node) in SPINS for node in nodes)
    leaves = any(isinstance(node, ast.Break | ast.Return) for node in nodes)
    return awaits or spins or leaves


def _repeats_few_times(loop: ast.AST) -> bool:
    """Whether the source shows that a loop repeats ten times at most."""
    if isinstance(loop, ast.For | ast.AsyncFor):
        over = loop.iter
    elif isinstance(loop, ast.ListComp | ast.GeneratorExp):
        over = loop.generators[0].iter
    else:
        return False
    if isinstance(over, ast.List | ast.Tuple):
        return len(over.elts) <= _IN_FLIGHT
    if isinstance(over, ast.Call) and called(over) == "range":
        numbers = [each.value for each in over.args if isinstance(each, ast.Constant)]
        if len(numbers) == len(over.args) and all(isinstance(one, int) for one in numbers):
            return len(range(*(one for one in numbers if isinstance(one, int)))) <= _IN_FLIGHT
    return False


# Service callbacks without a response


def _services_without_response(program: Program) -> Iterator[Finding]:
    reported: set[Function] = set()
    for callback in program.callbacks:
        function = callback.function
        if callback.kind != "create_service" or function in reported:
            continue
        reported.add(function)
        if not isinstance(function, ast.Lambda):
            yield from _returns(function)
            yield from _raises(program, function)


def _returns(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[Finding]:
    if not _never_reaches_end(function.body):
        yield finding_at(
            function,
            f"{function.name} can end without return response",
            _NO_RESPONSE,
            "return the response on every path",
        )
    for node in own_nodes(function):
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Constant | None):
            returned = "nothing" if node.value is None else ast.unparse(node.value)
            yield finding_at(
                node,
                f"{function.name} returns {returned}",
                _NO_RESPONSE,
                "set the response's fields and return it",
            )


def _raises(program: Program, function: Function) -> Iterator[Finding]:
    for node in own_nodes(function):
        if isinstance(node, ast.Raise) and not _is_caught(program, node, function):
            yield finding_at(
                node,
                "a raise in a service callback",
                _NO_RESPONSE,
                "return a response whose fields report the problem, such as success and message",
            )


def _two_servers(program: Program) -> Iterator[Finding]:
    seen: set[str] = set()
    for call in program.made_by("create_service"):
        name = call.args[1] if len(call.args) > 1 else None
        if not isinstance(name, ast.Constant) or not isinstance(name.value, str):
            continue
        if name.value in seen:
            yield finding_at(
                call,
                f"a second server of {name.value!r}",
                "in ROS 2 both execute each request, and the client takes the first response",
                "give each service its own name",
            )
        seen.add(name.value)


def _never_reaches_end(body: Sequence[ast.stmt]) -> bool:
    """Whether execution always leaves some statements before their end."""
    return any(_leaves(statement) for statement in body)


def _leaves(node: ast.stmt) -> bool:
    found = False
    match node:
        case ast.Return() | ast.Raise():
            found = True
        case ast.If(body=body, orelse=other):
            found = _never_reaches_end(body) and _never_reaches_end(other)
        case ast.With(body=body) | ast.AsyncWith(body=body):
            found = _never_reaches_end(body)
        case ast.Try(body=body, handlers=handlers, orelse=other, finalbody=final):
            tried = _never_reaches_end(body) or _never_reaches_end(other)
            handled = all(_never_reaches_end(each.body) for each in handlers)
            found = _never_reaches_end(final) or (tried and handled)
        case ast.While(test=ast.Constant(value=value), body=body):
            found = bool(value) and not any(isinstance(one, ast.Break) for one in _inner(body))
        case ast.Match(cases=cases):
            last = cases[-1]
            is_whole = isinstance(last.pattern, ast.MatchAs) and last.pattern.pattern is None
            always = all(_never_reaches_end(each.body) for each in cases)
            found = is_whole and last.guard is None and always
    return found


def _inner(body: Sequence[ast.stmt]) -> Iterator[ast.AST]:
    return (node for statement in body for node in ast.walk(statement))


def _is_caught(program: Program, node: ast.Raise, function: Function) -> bool:
    below: ast.AST = node
    for each in program.above(node):
        if isinstance(each, ast.Try) and below in each.body and each.handlers:
            return True
        if each is function:
            return False
        below = each
    return False


# Facts about a program


def _is_client(program: Program, call: ast.Call) -> bool:
    return receiver(call) in program.clients


def _is_awaited(program: Program, step: Step) -> bool:
    return any(isinstance(each, ast.Await) for each in program.above(step.call))


def _may_overlap(program: Program) -> bool:
    """Whether callbacks may run in parallel: several threads, and callback groups that allow it."""
    groups = [call for call in program.calls if called(call).endswith("CallbackGroup")]
    given = [call for call in program.calls if argument(call, 99, "callback_group") is not None]
    return bool(program.made_by("MultiThreadedExecutor") and groups and given)
