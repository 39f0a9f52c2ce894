"""Where a program would wait for ever: calls, spins and sleeps inside callbacks, lost answers."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from taskrpc.graduation.program import Finding, Program, Step, argument, at, called, receiver

_SPINS = frozenset({"spin", "spin_once", "spin_until_future_complete"})
_IN_FLIGHT = 10
_LOST = "the eleventh to a service pushes the first out of its queue, which is never answered"


def waiting(program: Program) -> Iterator[Finding]:
    """All of these in a program."""
    yield from _in_callbacks(program)
    yield from _calls_that_nobody_spins(program)
    yield from _futures_that_nobody_spins(program)
    yield from _not_waited_for(program)
    yield from _too_many(program)


def _in_callbacks(program: Program) -> Iterator[Finding]:
    told: set[ast.Call] = set()
    for step in program.inside:
        if step.call in told:
            continue
        found = list(_in_callback(program, step))
        if found:
            told.add(step.call)
        yield from found


def _in_callback(program: Program, step: Step) -> Iterator[Finding]:
    name, way = called(step.call), " > ".join(step.through)
    if name == "call" and _is_client(program, step.call) and not _may_overlap(program):
        yield at(
            step.call,
            f"{receiver(step.call)}.call inside a callback ({way})",
            "ROS 2 hangs: the thread that should take the answer waits for it",
            "use await call_async(...) in an async def callback, or add_done_callback",
        )
    elif name in _SPINS and _is_spin(step.call):
        yield at(
            step.call,
            f"{name} inside a callback ({way})",
            "ROS 2 hangs, or says that the executor is spinning already",
            "await the future in an async def callback, or add_done_callback",
        )
    elif name == "sleep" and receiver(step.call) in ("time", "") and not _is_awaited(program, step):
        yield at(
            step.call,
            f"sleep inside a callback ({way})",
            "ROS 2 runs no other callback of the node meanwhile",
            "use a timer, or a callback group of its own and a MultiThreadedExecutor",
        )
    elif name == "sleep" and "rate" in receiver(step.call).lower() and not _may_overlap(program):
        yield at(
            step.call,
            f"{receiver(step.call)}.sleep inside a callback ({way})",
            "ROS 2 hangs: the thread that would wake it sleeps",
            "use a timer",
        )


def _calls_that_nobody_spins(program: Program) -> Iterator[Finding]:
    inside = {step.call for step in program.inside}
    if _spins_elsewhere(program):
        return
    for call in program.made_by("call"):
        if _is_client(program, call) and call not in inside:
            yield at(
                call,
                f"{receiver(call)}.call while no other thread spins",
                "ROS 2 waits for ever",
                "use call_async and rclpy.spin_until_future_complete",
            )


def _futures_that_nobody_spins(program: Program) -> Iterator[Finding]:
    for call in program.made_by("result"):
        inner = call.func.value if isinstance(call.func, ast.Attribute) else None
        if isinstance(inner, ast.Call) and called(inner) == "call_async":
            yield at(
                call,
                "result() of a call that has just been sent",
                "it is None in ROS 2, which takes the answer only while somebody spins",
                "spin_until_future_complete first, or await the future",
            )
    loops = [node for node in ast.walk(program.tree) if isinstance(node, ast.While)]
    for loop in [] if _spins_elsewhere(program) else loops:
        if _waits_without_spin(loop):
            yield at(
                loop,
                "a loop until a future is done, without a spin in it",
                "ROS 2 never leaves it",
                "use rclpy.spin_until_future_complete, or spin_once in the loop",
            )
    sent = program.made_by("call_async")
    is_program = bool(program.made_by("init"))
    spins = any(_is_spin(call) for call in program.calls) or _spins_elsewhere(program)
    if sent and is_program and not spins:
        yield at(
            sent[0],
            "call_async in a program that never spins",
            "ROS 2 never takes the answer",
            "use rclpy.spin_until_future_complete",
        )


def _not_waited_for(program: Program) -> Iterator[Finding]:
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
            yield at(
                made,
                f"{name} calls without wait_for_service",
                "a request that ROS 2 sends before the server is found is lost, and never answered",
                f"wait first: while not {name}.wait_for_service(timeout_sec=1.0): ...",
            )


def _too_many(program: Program) -> Iterator[Finding]:
    for call in program.made_by("call_async"):
        loop = next((each for each in program.above(call) if isinstance(each, _Loops)), None)
        if loop is None or _waits_inside(loop) or _few(loop):
            continue
        yield at(
            call,
            "call_async in a loop that does not wait",
            f"ROS 2 keeps {_IN_FLIGHT} requests: {_LOST}",
            f"wait for the answers before there are more than {_IN_FLIGHT} in flight",
        )


_Loops = ast.For | ast.While | ast.ListComp | ast.GeneratorExp | ast.AsyncFor


def _waits_inside(loop: ast.AST) -> bool:
    nodes = list(ast.walk(loop))
    awaited = any(isinstance(node, ast.Await) for node in nodes)
    spun = any(isinstance(node, ast.Call) and _is_spin(node) for node in nodes)
    left = any(isinstance(node, ast.Break | ast.Return) for node in nodes)
    return awaited or spun or left


def _few(loop: ast.AST) -> bool:
    """Whether a loop is seen to go round ten times at most."""
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


def _waits_without_spin(loop: ast.While) -> bool:
    asks = any(
        isinstance(node, ast.Call) and called(node) == "done" for node in ast.walk(loop.test)
    )
    calls = [node for node in ast.walk(loop) if isinstance(node, ast.Call)]
    return asks and not any(_is_spin(call) for call in calls)


def _is_client(program: Program, call: ast.Call) -> bool:
    return receiver(call) in program.clients


def _is_spin(call: ast.Call) -> bool:
    return called(call) in _SPINS


def _is_awaited(program: Program, step: Step) -> bool:
    return any(isinstance(each, ast.Await) for each in program.above(step.call))


def _may_overlap(program: Program) -> bool:
    """Whether callbacks may run side by side: several threads, and groups that say so."""
    groups = [call for call in program.calls if called(call).endswith("CallbackGroup")]
    given = [call for call in program.calls if argument(call, 99, "callback_group") is not None]
    return bool(program.made_by("MultiThreadedExecutor") and groups and given)


def _spins_elsewhere(program: Program) -> bool:
    """Whether a thread of its own spins."""
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
