"""Functions and coroutines that an executor runs, step by step, as futures."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Iterable, Mapping
from types import CoroutineType
from typing import TYPE_CHECKING, Any, TypeVar

from .future import Future, Step, running_steps

if TYPE_CHECKING:
    from ._impl.execution.entity import Entity
    from .executors import Executor

T = TypeVar("T")


class Task(Future[T]):
    """A function or coroutine function that runs when the task is called.

    A coroutine runs to its next `await` of something that is not done; each further call goes on
    from there. Executors make tasks (`create_task`) and call them.
    """

    def __init__(
        self,
        handler: Callable[..., Any],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(executor=executor)
        args = () if args is None else tuple(args)
        kwargs = {} if kwargs is None else dict(kwargs)
        if inspect.iscoroutinefunction(handler):
            handler, args, kwargs = handler(*args, **kwargs), (), {}
        self._handler: Any = handler
        self._args = args
        self._kwargs = kwargs
        self._executing = False
        self._task_lock = threading.Lock()
        self._entity: Entity | None = None
        self._node: Any = None
        self._number = 0
        self._reported = False

    def __call__(self) -> None:
        """Run the function, or the coroutine's next step; what it raises is the exception."""
        if self._done or not self._task_lock.acquire(blocking=False):
            return
        awaited: Any = self
        try:
            self._executing = True
            if type(self._handler) is CoroutineType:
                awaited = self._step(self._handler)
            elif self._handler is not None:  # else another thread has just finished it
                self._finish(self._handler)
        finally:
            self._executing = False
            self._task_lock.release()
        if awaited is not self:  # after the lock: who wakes it may call it at once
            self._await(awaited)

    def executing(self) -> bool:
        """Whether it runs at this moment, on some thread."""
        return self._executing

    def _runnable(self) -> bool:
        """Whether there is a next step; one that was cancelled takes none."""
        if self._cancelled and type(self._handler) is CoroutineType:
            self._handler.close()
        return not self._done and not self._cancelled

    def _report(self) -> bool:
        """Whether nobody has been told yet how it ended; True once."""
        with self._lock:
            first = not self._reported
            self._reported = True
            return first

    def _step(self, coroutine: CoroutineType[Any, Any, T]) -> Any:
        """What the coroutine awaits now; this task itself when it awaits nothing more."""
        thread, step = threading.get_ident(), Step()
        outer = running_steps.get(thread)
        running_steps[thread] = step
        try:
            coroutine.send(None)
            return step.awaited
        except StopIteration as stop:
            self._forget()
            self.set_result(stop.value)
        except Exception as error:
            self._forget()
            self.set_exception(error)
        finally:
            if outer is None:
                del running_steps[thread]
            else:
                running_steps[thread] = outer
        return self

    def _finish(self, function: Callable[..., T]) -> None:
        args, kwargs = self._args, self._kwargs
        try:
            result = function(*args, **kwargs)
        except Exception as error:
            self._forget()
            self.set_exception(error)
        else:
            self._forget()
            self.set_result(result)

    def _await(self, awaited: Any) -> None:
        """Have the executor call this again when what is awaited is done."""
        executor = self._executor()
        if executor is None:
            return
        if awaited is not None:
            awaited._awaited_by = self
            awaited._when_done(lambda: executor._resume(self))
        else:  # a bare yield: the next round
            executor._resume(self)

    def _forget(self) -> None:
        """Drop what it ran, which may hold much else."""
        self._handler, self._args, self._kwargs = None, (), {}


__all__ = ["Future", "Task"]
