"""Explains in one line what ROS 2 would do where taskrpc helps; `like_ros` turns the help off."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

from taskrpc.node import unspun_text
from taskrpc.spi import problem_of_callback

_reported: set[tuple[object, ...]] = set()
"""The causes whose line was printed."""
_lock = threading.Lock()
_loses_failed_calls = False


@functools.cache
def like_ros() -> bool:
    """Whether to behave exactly as ROS 2 instead of helping (`TASKRPC_LIKE_ROS=1`)."""
    return os.environ.get("TASKRPC_LIKE_ROS") == "1"


def lose_failed_calls() -> None:
    """Let the future of a failed call stay undone from now on, as ROS 2 does."""
    global _loses_failed_calls
    _loses_failed_calls = True


def loses_failed_calls() -> bool:
    """Whether the future of a failed call is never done; otherwise it gets the error."""
    return _loses_failed_calls or like_ros()


def call_deadlock(service: str, callback: str, why: str) -> str:
    """Report `Client.call` in a callback that prevents its response; return the sentence."""
    cycle = f"{callback} -> {service} -> {why} -> {callback}"
    sentence = (
        f"hang here for ever: Client.call in a callback waits in a circle: {cycle}; make the"
        " callback `async def` and `await client.call_async(request)`, with the client in a"
        " ReentrantCallbackGroup (or give it that group and spin a MultiThreadedExecutor)"
    )
    report(("hang", callback, service), sentence)
    return f"ROS 2 would {sentence}"


def call_times_out(service: str, callback: str, seconds: float) -> None:
    """Report `Client.call` with a timeout in a callback that prevents its response."""
    report(
        ("hang", callback, service),
        f"wait {seconds:g} s here for nothing, and so does taskrpc: the response of {service}"
        f" cannot be taken while {callback} waits; make it `async def` and"
        " `await client.call_async(request)`, with the client in a ReentrantCallbackGroup",
    )


def pool_exhausted(calls: Sequence[tuple[str, str]]) -> None:
    """Report a pool whose threads all wait in `Client.call`: none is left to take a response."""
    waits = ", ".join(f"{callback} for {service}" for service, callback in calls)
    report(
        ("pool", waits),
        f"hang here for ever, and so does taskrpc: all {len(calls)} threads of the"
        f" MultiThreadedExecutor wait in Client.call ({waits}), and no thread is left to take a"
        f" response; use more threads, such as MultiThreadedExecutor(num_threads={2 * len(calls)}),"
        " or make the callbacks `async def` and `await client.call_async(request)`",
    )


def polling_deadlock(service: str, callback: str, why: str) -> None:
    """Report a callback that polls for a response and prevents it meanwhile."""
    report(
        ("polled", callback, service),
        f"wait here for ever, and so does taskrpc: {callback} checks repeatedly whether {service}"
        f" has answered, and meanwhile holds {why}; make it `async def` and"
        " `await client.call_async(request)`, with the client in a ReentrantCallbackGroup",
    )


def spin_deadlock(service: str, callback: str, why: str) -> str:
    """Report a spin in a callback for a response that the callback prevents; return the sentence.

    `why` is what the callback holds.
    """
    sentence = (
        f"hang here for ever: {callback} spins until {service} has answered, but itself holds"
        f" {why}, which the response needs; make the callback `async def`"
        " and `await` the future instead of spinning, with the client in a ReentrantCallbackGroup"
    )
    report(("spin", callback), sentence)
    return f"ROS 2 would {sentence}"


def rate_deadlock(callback: str) -> str:
    """Report `Rate.sleep` in a callback, on the only thread that could wake it; return the text."""
    sentence = (
        f"hang here for ever: Rate.sleep in {callback} waits for a timer, and blocks the only"
        " thread that could run this timer; let a timer of that period call the callback instead,"
        " or spin a MultiThreadedExecutor"
    )
    report(("rate", callback), sentence)
    return f"ROS 2 would {sentence}"


def rate_unspun(node: str) -> None:
    """Report `Rate.sleep` while no thread spins the node; here the sleep ends on time."""
    report(
        ("unspun rate", node),
        "hang here for ever: Rate.sleep waits for a timer that does not run, because no other"
        f" thread spins {node}; spin it: threading.Thread(target=rclpy.spin, args=(node,),"
        " daemon=True).start() (or sleep with time.sleep)",
    )


def removed_from_spin(node: str, callback: str) -> None:
    """Report a spin in a callback that removes the node from the outer spin."""
    report(
        ("removed", node),
        f"run no callback of {node} after this, and neither does taskrpc: {callback} spins the node"
        " a second time, and at its end removes the node from the outer spin (from rclpy"
        " 7.1.9 on: RuntimeError('Executor is already spinning')); make the callback"
        " `async def` and `await` the future instead",
    )


def invalid_response(service: str, problem: str) -> None:
    """Report a service callback that returned a value that is not a response."""
    report(
        ("response", service),
        f"never answer this call, and raise a TypeError without a message: {problem}",
    )


def invalid_result(action: str, problem: str) -> None:
    """Report an execute callback that returned a value that is not a result."""
    report(
        ("result", action),
        "end the spin of the server with an AttributeError, and leave the client waiting for ever:"
        f" {problem}",
    )


def invalid_cancel_response(action: str, returned: str) -> None:
    """Report a cancel callback that returned a value that is not a CancelResponse."""
    report(
        ("cancel", action),
        "refuse this cancellation without an error, and so does taskrpc: the cancel callback of"
        f" {action} returned {returned}; return CancelResponse.ACCEPT or CancelResponse.REJECT",
    )


def callback_parameters(
    callback: Callable[..., Any] | None, description: str, *parameters: str
) -> None:
    """Report a callback that cannot be called with an argument for each of the parameters.

    ROS accepts it, too, and fails at the first call.
    """
    if callback is None or like_ros():
        return
    if problem := problem_of_callback(callback, description, parameters):
        report(
            ("parameters", problem),
            f"raise TypeError when this callback is first called, and so does taskrpc: {problem}",
        )


def callback_raised(service: str, problem: str) -> None:
    """Report an exception in a service callback; here the caller gets an error."""
    report(
        ("raised", service),
        f"leave the caller waiting for ever: {problem}; catch the exception, and report the failure"
        " in the response",
    )


def transition_callback_raised(node: str, callback: str, error: Exception) -> None:
    """Report an exception in a transition callback of a lifecycle node."""
    what = f"{type(error).__name__}: {error}"
    report(
        ("transition", node, callback),
        f"print nothing here: {callback} of {node} raised {what}; it counts as"
        " TransitionCallbackReturn.ERROR",
    )


def impossible_transition(node: str, number: int, error: Exception) -> None:
    """Report a request, by number, for a transition that is not possible now."""
    report(
        ("impossible", node),
        f"end the spin of {node} here, with RCLError: a caller requested the transition"
        f" {number}, which is not possible now ({error}); request it by its label: ROS 2 refuses"
        " that without an error in the node",
    )


def service_destroyed(service: str) -> None:
    """Report a service callback that destroyed its service or node; the caller gets an error."""
    report(
        ("destroyed", service),
        f"leave the caller waiting for ever: the callback of {service} destroyed its"
        " service, or its node, before it returned; destroy them later, from a timer or after"
        " the spin",
    )


def call_failed(service: str, error: BaseException) -> None:
    """Report a call that ended with an error, which a future in ROS never has."""
    report(
        ("failed", service, type(error)),
        f"never complete this future: the call of {service} failed ({error}); in ROS 2, wait with"
        " a timeout: spin_until_future_complete(node, future, timeout_sec=...)",
    )


def type_mismatch(service: str, type_name: str, error: BaseException) -> None:
    """Report a client whose service exists with another type, so that it cannot be called."""
    report(
        ("unoffered", service),
        "find no server for this client, wait for ever and not say why: the client is for"
        f" {type_name}, but {error}",
    )


def profiles_differ(service: str, problem: str) -> None:
    """Report a client and a server whose QoS profiles never match in ROS 2."""
    report(
        ("qos", service),
        f"never connect the client and the server of {service}, and not say why: their QoS"
        f" profiles do not match ({problem}); taskrpc answers the calls; give both the same"
        " qos_profile",
    )


def call_unspun(service: str, node: str) -> None:
    """Report `Client.call` while no thread spins the node; here the response still arrives."""
    report(
        ("unspun", node),
        f"hang here for ever: Client.call of {service} waits for a response that no thread"
        f" takes, because no other thread spins {node}; use call_async and"
        " rclpy.spin_until_future_complete(node, future)",
    )


def never_spun(node: str, offered: Sequence[str]) -> None:
    """Report a node with callbacks that ended before a thread spun it; ROS ends it in silence."""
    if not like_ros() and sys.stderr is not None:
        text = unspun_text(node, offered, "call rclpy.spin(node)")
        print(f"[taskrpc] {text}", file=sys.stderr, flush=True)


def two_servers(service: str, *, refused: bool) -> None:
    """Report a second server of a name, which is refused or waits for the end of the first one."""
    if refused:
        here = (
            "taskrpc refuses the second one; start it in a namespace, with"
            " --ros-args -r __ns:=/second, or end the first one; with `taskrpc run --like-ros`"
            " it starts too"
        )
    else:
        here = "in taskrpc only the first one runs them; give one of them another name, or end it"
    report(
        ("two", service),
        f"let both servers of {service} run every request, and use the response that arrives first;"
        f" {here}",
    )


def too_many_requests(service: str, depth: int) -> None:
    """Report that more requests wait than ROS keeps."""
    report(
        ("depth", service),
        f"drop the oldest of more than {depth} requests that wait for {service}, and"
        f" never answer it; keep at most {depth} calls in flight",
    )


def number_wrapped(name: str, error: Exception, wrapped: Any) -> None:
    """Report a number too large for its field, which ROS would have sent as another number."""
    report(("wrap", name), f"send {wrapped} to {name} without an error; taskrpc refuses: {error}")


def report(cause: tuple[object, ...], sentence: str) -> None:
    """Print what ROS 2 would do, once for each cause; nothing when `like_ros` is on."""
    if like_ros():
        return
    with _lock:
        if cause in _reported:
            return
        _reported.add(cause)
    if sys.stderr is not None:  # None under pythonw, and at the very end of a program
        print(f"[taskrpc] ROS 2 would {sentence}", file=sys.stderr, flush=True)
