"""Says in one line what ROS 2 would have done where we help; or, on request, lets it happen."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ...client import Client
    from ...service import Service
    from ..execution.running_callbacks import Callback

_told: set[tuple[object, ...]] = set()
_lock = threading.Lock()


@functools.cache
def like_ros() -> bool:
    """Whether to behave as ROS 2 does instead of helping (`TASKRPC_LIKE_ROS=1`)."""
    return os.environ.get("TASKRPC_LIKE_ROS") == "1"


def would_hang(client: Client[Any, Any], callback: Callback, why: str) -> str:
    """`Client.call` in a callback, which keeps the answer from being taken; the whole sentence."""
    cycle = f"{name_of(callback)} -> {client.service_name} -> {why} -> {name_of(callback)}"
    sentence = f"hang here for ever: Client.call in a callback waits in a circle: {cycle}"
    fix = "; make the callback `async def` and `await client.call_async(request)`, with the client"
    fix += " in a ReentrantCallbackGroup (or give it that group and spin a MultiThreadedExecutor)"
    tell(("hang", name_of(callback), client.service_name), sentence + fix)
    return f"ROS 2 would {sentence}{fix}"


def would_wait_in_vain(client: Client[Any, Any], callback: Callback, seconds: float) -> None:
    """`Client.call` with a timeout, in a callback that keeps the answer from being taken."""
    tell(
        ("hang", name_of(callback), client.service_name),
        f"wait {seconds:g} s here in vain, as we do: {name_of(callback)} keeps the answer of"
        f" {client.service_name} from being taken; make it `async def` and"
        " `await client.call_async(request)`, with the client in a ReentrantCallbackGroup",
    )


def no_thread_left(calls: Sequence[tuple[Client[Any, Any], Callback]]) -> None:
    """All threads of a pool wait in `Client.call`: none is left that could take an answer."""
    who = ", ".join(f"{name_of(callback)} for {client.service_name}" for client, callback in calls)
    tell(
        ("pool", who),
        f"hang here for ever, as we do: all {len(calls)} threads of the MultiThreadedExecutor wait"
        f" in Client.call ({who}), and none is left to take an answer; give it more, as"
        f" MultiThreadedExecutor(num_threads={2 * len(calls)}), or make the callbacks `async def`"
        " and `await client.call_async(request)`",
    )


def polled_in_vain(client: Client[Any, Any], callback: Callback, why: str) -> None:
    """A callback asks again and again for an answer that it keeps from being taken."""
    name = name_of(callback)
    tell(
        ("polled", name, client.service_name),
        f"wait here for ever, as we do: {name} asks again and again whether {client.service_name}"
        f" has answered, and meanwhile keeps {why}; make it `async def` and"
        " `await client.call_async(request)`, with the client in a ReentrantCallbackGroup",
    )


def spun_in_vain(client: Client[Any, Any], callback: Callback, why: str) -> str:
    """A spin in a callback for an answer that cannot be taken meanwhile; the whole sentence."""
    name = name_of(callback)
    sentence = (
        f"hang here for ever: {name} spins until {client.service_name} has answered, but the answer"
        f" waits for {why}, held by {name}; make the callback `async def`"
        " and `await` the future instead of spinning, with the client in a ReentrantCallbackGroup"
    )
    tell(("spin", name_of(callback)), sentence)
    return f"ROS 2 would {sentence}"


def would_oversleep(callback: Callback) -> str:
    """`Rate.sleep` in a callback, on the only thread that could wake it; the whole sentence."""
    sentence = (
        f"hang here for ever: Rate.sleep in {name_of(callback)} waits for a timer that only the"
        " thread could run that sleeps; have a timer of that period call the callback instead, or"
        " spin a MultiThreadedExecutor"
    )
    tell(("rate", name_of(callback)), sentence)
    return f"ROS 2 would {sentence}"


def nobody_woke(node: Any) -> None:
    """`Rate.sleep` while nobody spins: it ends at its time all the same."""
    tell(
        ("unspun rate", shown(node)),
        f"hang here for ever: Rate.sleep waits for a timer that nobody runs, as no other thread"
        f" spins {shown(node)}; have one do so: threading.Thread(target=rclpy.spin, args=(node,),"
        " daemon=True).start() (or sleep by time.sleep)",
    )


def went_deaf(node: Any, callback: Callback) -> None:
    """A spin in a callback, after which the outer spin has the node no more."""
    tell(
        ("deaf", node.get_name()),
        f"run no callback of {shown(node)} any more after this: {name_of(callback)} spins the node"
        " that is being spun, and at its end takes it away from the outer spin, as here (from rclpy"
        " 7.1.9 on: RuntimeError('Executor is already spinning')); make the callback"
        " `async def` and `await` the future instead",
    )


def answered_nothing(service: Service[Any, Any], problem: str) -> None:
    """A service callback returned something that is no response."""
    tell(
        ("response", service.service_name),
        f"never answer this call, and tell nobody why (a bare TypeError): {problem}",
    )


def raised(service: Service[Any, Any], problem: str) -> None:
    """A service callback raised: the caller is told here."""
    tell(
        ("raised", service.service_name),
        f"leave the caller waiting for ever: {problem}; catch it, and say so in the response",
    )


def swallowed(node: Any, callback: str, error: Exception) -> None:
    """A lifecycle node's callback raised, which counts as TransitionCallbackReturn.ERROR."""
    what = f"{type(error).__name__}: {error}"
    tell(
        ("swallowed", shown(node), callback),
        f"say nothing here: {callback} of {shown(node)} raised {what}; it counts as"
        " TransitionCallbackReturn.ERROR",
    )


def impossible_step(node: Any, number: int, error: Exception) -> None:
    """Somebody asked a lifecycle node, by number, for a step that is not possible now."""
    tell(
        ("impossible", shown(node)),
        f"end the spin of {shown(node)} here, with RCLError: somebody asked for the transition"
        f" {number}, which is not possible now ({error}); ask by label, which is refused",
    )


def destroyed(service: Service[Any, Any]) -> None:
    """A service callback destroyed its service, or its node: the caller is told here."""
    tell(
        ("destroyed", service.service_name),
        f"leave the caller waiting for ever: the callback of {service.service_name} destroyed its"
        " service, or its node, and returned only then; destroy them later, from a timer or after"
        " the spin",
    )


def failed(client: Client[Any, Any], error: BaseException) -> None:
    """A call ended with an error, which a future in ROS never has."""
    tell(
        ("failed", client.service_name, type(error)),
        f"never complete this future: the call of {client.service_name} failed ({error}); wait with"
        " a timeout there, as spin_until_future_complete(node, future, timeout_sec=...)",
    )


def mismatched(client: Client[Any, Any], error: BaseException) -> None:
    """A service that is there has another definition: its server cannot be called."""
    tell(
        ("unoffered", client.service_name),
        "find no server for this client, wait for ever and not say why: it is for"
        f" {client.srv_type._TYPE}, but {error}",
    )


def profiles_differ(service: str, problem: str) -> None:
    """The QoS profiles of a service's client and server never match in ROS 2."""
    tell(
        ("qos", service),
        f"never connect the client and the server of {service}, and would not say why: their QoS"
        f" profiles do not match ({problem}); here the calls are answered; give both the same"
        " qos_profile",
    )


def nobody_spun(client: Client[Any, Any]) -> None:
    """`Client.call` while nobody takes its answer: it is taken all the same."""
    tell(
        ("unspun", shown(client._node)),
        f"hang here for ever: Client.call of {client.service_name} waits for an answer that nobody"
        f" takes, as no other thread spins {shown(client._node)}; use call_async and"
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


def too_many(service: Service[Any, Any], depth: int) -> None:
    """More requests wait than ROS keeps."""
    tell(
        ("depth", service.service_name),
        f"drop the oldest of more than {depth} requests that wait for {service.service_name}, and"
        f" never answer it; keep at most {depth} calls in flight",
    )


def would_wrap(name: str, error: Exception, wrapped: Any) -> None:
    """A number too large for its field, which ROS would have sent as another one."""
    tell(("wrap", name), f"send {wrapped} to {name} without a word; we refuse it: {error}")


def name_of(callback: Callback) -> str:
    """How a message names a callback: its function and its node."""
    entity = callback.entity
    if entity is None:
        return "a task or done callback"
    function = getattr(entity, "callback", None)
    function = getattr(function, "__qualname__", type(entity).__name__)
    service = getattr(entity, "service_name", "")
    offered = f" (service {service})" if service else ""
    return f"{function}(){offered} of {shown(entity._node)}"


def shown(node: Any) -> str:
    """A node as messages name it; also one that is destroyed."""
    namespace = getattr(node, "_rclpy_namespace", "/").rstrip("/")
    return f"{namespace}/{getattr(node, '_rclpy_name', type(node).__name__)}"


def tell(cause: tuple[object, ...], sentence: str) -> None:
    """Print what ROS 2 would do, once for each cause; nothing where it is what happens."""
    if like_ros():
        return
    with _lock:
        if cause in _told:
            return
        _told.add(cause)
    if sys.stderr is not None:  # pythonw, or a program's very end
        print(f"[taskrpc] ROS 2 would {sentence}", file=sys.stderr, flush=True)
