"""Accelerated time: a process in which seconds pass several times faster.

`install` replaces the clocks and the waits of Python, before the process imports anything that
keeps them. `set_speed` then says how much faster. Replaced are `time`'s clocks and `sleep`, the
timeouts of `threading`, `queue`, `select` and `selectors`, and with these asyncio and taskrpc's
rclpy. Not replaced are `datetime`, timeouts of sockets, and signals such as `signal.alarm`.
"""

from __future__ import annotations

import _thread
import queue
import select
import selectors
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

_CLOCKS = ("time", "monotonic", "perf_counter")
_NS = 10**9
_real: dict[str, Callable[[], int]] = {name: getattr(time, f"{name}_ns") for name in _CLOCKS}
_anchors: dict[str, tuple[int, int]] = {}
"""For each clock, an instant in nanoseconds as the system says it, and as this process sees it."""
_speed = 1.0
_RLOCK: Any = _thread.RLock

real_monotonic = time.monotonic
"""The system's own clock, for limits that hold in real time."""


def speed() -> float:
    """Return how many seconds of this process pass in a second."""
    return _speed


def set_speed(factor: float, wall: tuple[int, int] | None = None) -> None:
    """Let time pass `factor` times faster from now on; needs `install`.

    Args:
        factor: 1 for real time.
        wall: what `wall_clock` returned in another process, so that both have the same time.
    """
    global _speed
    for name, real in _real.items():
        now = real()
        _anchors[name] = now, _seen(name, now)
    if wall is not None:
        _anchors["time"] = wall
    _speed = factor


def wall_clock() -> tuple[int, int] | None:
    """Return the anchor of the wall clock, for `set_speed` in another process."""
    return _anchors.get("time")


def install() -> None:
    """Replace the clocks and waits of this process; a second call has no effect.

    Modules that are imported already get the new functions too.
    """
    if _anchors:
        return
    for name, real in _real.items():
        _anchors[name] = real(), real()
    replaced: dict[object, object] = {time.sleep: _slower(time.sleep)}
    for name in _CLOCKS:
        replaced[getattr(time, name)] = _seconds(name)
        replaced[getattr(time, f"{name}_ns")] = _nanoseconds(name)
    for module in list(sys.modules.values()):
        for attribute, value in list(getattr(module, "__dict__", {}).items()):
            if module is not sys.modules[__name__] and _is_in(value, replaced):
                setattr(module, attribute, replaced[value])
    lock: Any = _Lock
    vars(threading).update(Lock=lock, _allocate_lock=lock, _CRLock=_RLock)
    thread: Any = threading.Thread
    thread.join = _with_timeout(thread.join)
    vars(queue)["SimpleQueue"] = _SimpleQueue
    select_function: Any = select.select
    vars(select)["select"] = lambda *lists_and_timeout: select_function(
        *lists_and_timeout[:3], *map(_shorter, lists_and_timeout[3:])
    )
    for kind in vars(selectors).values():
        if isinstance(kind, type) and "select" in vars(kind):
            selector: Any = kind
            selector.select = _with_timeout(selector.select)
    if sys.platform == "win32":
        from asyncio import windows_events

        proactor: Any = windows_events.IocpProactor
        proactor.select = _with_timeout(proactor.select)


def _is_in(value: object, replaced: dict[object, object]) -> bool:
    return callable(value) and type(value).__hash__ is not None and value in replaced


def _seen(name: str, now: int) -> int:
    real, seen = _anchors[name]
    return seen + int((now - real) * _speed)


def _seconds(name: str) -> Callable[[], float]:
    real = _real[name]

    def clock() -> float:
        return _seen(name, real()) / _NS

    return clock


def _nanoseconds(name: str) -> Callable[[], int]:
    real = _real[name]

    def clock() -> int:
        return _seen(name, real())

    return clock


def _shorter(timeout: float | None) -> float | None:
    """The real time of a wait; None and negative numbers, which mean no limit, stay."""
    return timeout if timeout is None or timeout < 0 else timeout / _speed


def _slower(sleep: Callable[[float], None]) -> Callable[[float], None]:
    def slept(seconds: float, /) -> None:
        sleep(seconds / _speed)

    return slept


def _with_timeout(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method whose only argument is a timeout."""

    def wait(self: Any, timeout: float | None = None) -> Any:
        return method(self, _shorter(timeout))

    return wait


class _Lock:
    """`threading.Lock`, whose type in C cannot be derived from."""

    __slots__ = ("__weakref__", "_at_fork_reinit", "_lock", "locked", "release")

    def __init__(self) -> None:
        lock: Any = _thread.allocate_lock()
        self._lock = lock
        self.release = lock.release
        self.locked = lock.locked
        if sys.platform != "win32":
            self._at_fork_reinit = lock._at_fork_reinit

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Wait for the lock."""
        if timeout > 0:
            timeout /= _speed
        return bool(self._lock.acquire(blocking, timeout))

    def __enter__(self) -> bool:
        return bool(self._lock.acquire())

    def __exit__(self, *_: object) -> None:
        self._lock.release()


class _RLock(_RLOCK):  # type: ignore[misc]
    """`threading.RLock`."""

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Wait for the lock."""
        return bool(super().acquire(blocking, timeout / _speed if timeout > 0 else timeout))

    __enter__ = acquire


class _SimpleQueue(queue.SimpleQueue[Any]):
    """`queue.SimpleQueue`."""

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Wait for an item."""
        return super().get(block, _shorter(timeout))
