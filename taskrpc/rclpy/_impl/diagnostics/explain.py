"""Explains in one line what ROS 2 would do where taskrpc helps; `like_ros` turns the help off."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Sequence
from typing import Any

_reported: set[tuple[object, ...]] = set()
_lock = threading.Lock()


@functools.cache
def like_ros() -> bool:
    """Whether to behave exactly as ROS 2 instead of helping (`TASKRPC_LIKE_ROS=1`)."""
    return os.environ.get("TASKRPC_LIKE_ROS") == "1"


def would_hang(service: str, callback: str, why: str) -> str:
    """`Client.call` in a callback, which keeps the answer from being taken; the whole sentence."""
    cycle = f"{callback} -> {service} -> {why} -> {callback}"
    sentence = f"hang here for ever: Client.call in a callback waits in a circle: {cycle}"
    fix = "; make the callback `async def` and `await client.call_async(request)`, with the client"
    fix += " in a ReentrantCallbackGroup (or give it that group and spin a MultiThreadedExecutor)"
    tell(("hang", callback, service), sentence + fix)
    return f"ROS 2 would {sentence}{fix}"


def would_wait_in_vain(service: str, callback: str, seconds: float) -> None:
    """`Client.call` with a timeout, in a callback that keeps the answer from being taken."""
    tell(
        ("hang", callback, service),
        f"wait {seconds:g} s here in vain, as we do: {callback} keeps the answer of"
        f" {service} from being taken; make it `async def` and"
        " `await client.call_async(request)`, with the client in a ReentrantCallbackGroup",
    )


def no_thread_left(calls: Sequence[tuple[str, str]]) -> None:
    """All threads of a pool wait in `Client.call`: none is left that could take an answer."""
    who = ", ".join(f"{callback} for {service}" for service, callback in calls)
    tell(
        ("pool", who),
        f"hang here for ever, as we do: all {len(calls)} threads of the MultiThreadedExecutor wait"
        f" in Client.call ({who}), and none is left to take an answer; give it more, as"
        f" MultiThreadedExecutor(num_threads={2 * len(calls)}), or make the callbacks `async def`"
        " and `await client.call_async(request)`",
    )


def polled_in_vain(service: str, callback: str, why: str) -> None:
    """A callback asks again and again for an answer that it keeps from being taken."""
    tell(
        ("polled", callback, service),
        f"wait here for ever, as we do: {callback} asks again and again whether {service}"
        f" has answered, and meanwhile keeps {why}; make it `async def` and"
        " `await client.call_async(request)`, with the client in a ReentrantCallbackGroup",
    )


def spun_in_vain(service: str, callback: str, why: str) -> str:
    """A spin in a callback for an answer that cannot be taken meanwhile; the whole sentence."""
    sentence = (
        f"hang here for ever: {callback} spins until {service} has answered, but the answer"
        f" waits for {why}, held by {callback}; make the callback `async def`"
        " and `await` the future instead of spinning, with the client in a ReentrantCallbackGroup"
    )
    tell(("spin", callback), sentence)
    return f"ROS 2 would {sentence}"


def would_oversleep(callback: str) -> str:
    """`Rate.sleep` in a callback, on the only thread that could wake it; the whole sentence."""
    sentence = (
        f"hang here for ever: Rate.sleep in {callback} waits for a timer that only the"
        " thread could run that sleeps; have a timer of that period call the callback instead, or"
        " spin a MultiThreadedExecutor"
    )
    tell(("rate", callback), sentence)
    return f"ROS 2 would {sentence}"


def nobody_woke(node: str) -> None:
    """`Rate.sleep` while nobody spins: it ends at its time all the same."""
    tell(
        ("unspun rate", node),
        f"hang here for ever: Rate.sleep waits for a timer that nobody runs, as no other thread"
        f" spins {node}; have one do so: threading.Thread(target=rclpy.spin, args=(node,),"
        " daemon=True).start() (or sleep by time.sleep)",
    )


def went_deaf(node: str, callback: str) -> None:
    """A spin in a callback, after which the outer spin has the node no more."""
    tell(
        ("deaf", node),
        f"run no callback of {node} any more after this: {callback} spins the node"
        " that is being spun, and at its end takes it away from the outer spin, as here (from rclpy"
        " 7.1.9 on: RuntimeError('Executor is already spinning')); make the callback"
        " `async def` and `await` the future instead",
    )


def answered_nothing(service: str, problem: str) -> None:
    """A service callback returned something that is no response."""
    tell(
        ("response", service),
        f"never answer this call, and tell nobody why (a bare TypeError): {problem}",
    )


def raised(service: str, problem: str) -> None:
    """A service callback raised: the caller is told here."""
    tell(
        ("raised", service),
        f"leave the caller waiting for ever: {problem}; catch it, and say so in the response",
    )


def swallowed(node: str, callback: str, error: Exception) -> None:
    """A lifecycle node's callback raised, which counts as TransitionCallbackReturn.ERROR."""
    what = f"{type(error).__name__}: {error}"
    tell(
        ("swallowed", node, callback),
        f"say nothing here: {callback} of {node} raised {what}; it counts as"
        " TransitionCallbackReturn.ERROR",
    )


def impossible_step(node: str, number: int, error: Exception) -> None:
    """Somebody asked a lifecycle node, by number, for a step that is not possible now."""
    tell(
        ("impossible", node),
        f"end the spin of {node} here, with RCLError: somebody asked for the transition"
        f" {number}, which is not possible now ({error}); ask by label, which is refused",
    )


def destroyed(service: str) -> None:
    """A service callback destroyed its service, or its node: the caller is told here."""
    tell(
        ("destroyed", service),
        f"leave the caller waiting for ever: the callback of {service} destroyed its"
        " service, or its node, and returned only then; destroy them later, from a timer or after"
        " the spin",
    )


def failed(service: str, error: BaseException) -> None:
    """A call ended with an error, which a future in ROS never has."""
    tell(
        ("failed", service, type(error)),
        f"never complete this future: the call of {service} failed ({error}); wait with"
        " a timeout there, as spin_until_future_complete(node, future, timeout_sec=...)",
    )


def mismatched(service: str, type_name: str, error: BaseException) -> None:
    """A service that is there has another definition: its server cannot be called."""
    tell(
        ("unoffered", service),
        "find no server for this client, wait for ever and not say why: it is for"
        f" {type_name}, but {error}",
    )


def profiles_differ(service: str, problem: str) -> None:
    """The QoS profiles of a service's client and server never match in ROS 2."""
    tell(
        ("qos", service),
        f"never connect the client and the server of {service}, and would not say why: their QoS"
        f" profiles do not match ({problem}); here the calls are answered; give both the same"
        " qos_profile",
    )


def nobody_spun(service: str, node: str) -> None:
    """`Client.call` while nobody takes its answer: it is taken all the same."""
    tell(
        ("unspun", node),
        f"hang here for ever: Client.call of {service} waits for an answer that nobody"
        f" takes, as no other thread spins {node}; use call_async and"
        " rclpy.spin_until_future_complete(node, future)",
    )


def two_servers(service: str, *, refused: bool) -> None:
    """A second server of a name, which is refused or waits for the first one's end."""
    here = "the second one is refused here" if refused else "here the first one alone runs them"
    tell(
        ("two", service),
        f"let both servers of {service} run every request, and take whichever answer is first;"
        f" {here}; give one of them another name (or end it)",
    )


def too_many(service: str, depth: int) -> None:
    """More requests wait than ROS keeps."""
    tell(
        ("depth", service),
        f"drop the oldest of more than {depth} requests that wait for {service}, and"
        f" never answer it; keep at most {depth} calls in flight",
    )


def would_wrap(name: str, error: Exception, wrapped: Any) -> None:
    """A number too large for its field, which ROS would have sent as another one."""
    tell(("wrap", name), f"send {wrapped} to {name} without a word; we refuse it: {error}")


def tell(cause: tuple[object, ...], sentence: str) -> None:
    """Print what ROS 2 would do, once for each cause; nothing when `like_ros` is on."""
    if like_ros():
        return
    with _lock:
        if cause in _reported:
            return
        _reported.add(cause)
    if sys.stderr is not None:  # None under pythonw, and at the very end of a program
        print(f"[taskrpc] ROS 2 would {sentence}", file=sys.stderr, flush=True)
