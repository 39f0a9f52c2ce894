"""The buffer of transforms that programs use: lookups that can wait."""

from __future__ import annotations

import threading
import time as system_time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, JumpThreshold
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.task import Future
from rclpy.time import Time
from tf2_py import BufferCore

from .buffer_interface import BufferInterface

if TYPE_CHECKING:
    from rclpy.node import Node
    from tf2_msgs.srv import FrameGraph


class Buffer(BufferCore, BufferInterface):
    """The transforms that a TransformListener receives, or that the program sets.

    A lookup with a timeout blocks its thread. So another thread must spin the node of the
    listener: `spin_thread=True`, or a MultiThreadedExecutor. `lookup_transform_async` does not
    block.

    Args:
        cache_time: how long transforms are kept; 10 seconds by default.
        node: offers the service `tf2_frames`; if its clock jumps back, the buffer is cleared.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        BufferCore.__init__(self, *([] if cache_time is None else [cache_time]))
        BufferInterface.__init__(self)
        self._waiters: list[Callable[[], None]] = []
        """Functions that look again whether their transform is there, after each new one."""
        self._news = threading.Condition()
        """Notified after each new transform; also guards `_waiters`."""
        if node is None:
            self.clock = Clock()
        else:
            from tf2_msgs.srv import FrameGraph

            self.srv = node.create_service(FrameGraph, "tf2_frames", self._frame_graph)
            self.clock = node.get_clock()
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1))
        self.jump_handle = self.clock.create_jump_callback(
            threshold, post_callback=self.time_jump_callback
        )

    def _frame_graph(
        self, request: FrameGraph.Request, response: FrameGraph.Response
    ) -> FrameGraph.Response:
        response.frame_yaml = self.all_frames_as_yaml()
        return response

    def time_jump_callback(self, time_jump: Any) -> None:
        """Forget all transforms, because the clock has jumped back."""
        get_logger("tf2_buffer").warning("Detected jump back in time. Clearing tf buffer.")
        self.clear()

    def set_transform(self, transform: Any, authority: str) -> None:
        """Store a TransformStamped, and wake the waiting lookups."""
        super().set_transform(transform, authority)
        self._wake()

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Store a static TransformStamped, and wake the waiting lookups."""
        super().set_transform_static(transform, authority)
        self._wake()

    def _wake(self) -> None:
        with self._news:
            self._news.notify_all()
            waiters = list(self._waiters)
        for look_again in waiters:
            look_again()

    # Lookups

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008 - ROS's default; durations never change
    ) -> TransformStamped:
        """The transform that converts coordinates from the source frame to the target frame.

        Args:
            target_frame: the frame of the result.
            source_frame: the frame of the data.
            time: the time of the transform; `Time()` means the latest common time.
            timeout: how long to wait for the transform.

        Raises:
            TransformException: the transform is unknown; the subclass and the text say why.
        """
        self.can_transform(target_frame, source_frame, time, timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Time
    ) -> TransformStamped:
        """As `lookup_transform`, but wait for it without a time limit and without blocking."""
        await self.wait_for_transform_async(target_frame, source_frame, time)
        return self.lookup_transform_core(target_frame, source_frame, time)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> TransformStamped:
        """The transform from the source frame at one time to the target frame at another.

        `fixed_frame` does not move between the two times. Raises TransformException.
        """
        where = (target_frame, target_time, source_frame, source_time, fixed_frame)
        self.can_transform_full(*where, timeout)
        return self.lookup_transform_full_core(*where)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
    ) -> TransformStamped:
        """As `lookup_transform_full`, but wait for it without a limit and without blocking."""
        where = (target_frame, target_time, source_frame, source_time, fixed_frame)
        await self.wait_for_transform_full_async(*where)
        return self.lookup_transform_full_core(*where)

    # Waiting

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
        return_debug_tuple: bool = False,
    ) -> Any:
        """Whether the transform is there, or arrives within the timeout.

        Args:
            target_frame: as in `lookup_transform`.
            source_frame: likewise.
            time: likewise.
            timeout: how long to wait for the transform.
            return_debug_tuple: return a tuple of the answer and the reason for a False.
        """
        found = self._wait(
            lambda: self.can_transform_core(target_frame, source_frame, time), timeout
        )
        return found if return_debug_tuple else found[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
        return_debug_tuple: bool = False,
    ) -> Any:
        """As `can_transform`, for `lookup_transform_full`."""
        where = (target_frame, target_time, source_frame, source_time, fixed_frame)
        found = self._wait(lambda: self.can_transform_full_core(*where), timeout)
        return found if return_debug_tuple else found[0]

    def _wait(self, look: Callable[[], tuple[bool, str]], timeout: Duration) -> tuple[bool, str]:
        """Call `look` until it finds the transform or the timeout ends; return its last result.

        The timeout runs on the system's clock, as in ROS, so it also ends in a paused simulation.
        """
        if not hasattr(timeout, "nanoseconds"):
            kind = type(timeout).__qualname__
            raise TypeError(f"expected rclpy.duration.Duration as timeout, got {kind} {timeout!r}")
        end = system_time.monotonic() + timeout.nanoseconds / 1e9
        with self._news:
            while not (found := look())[0]:
                left = end - system_time.monotonic()
                if left <= 0 or not self._news.wait(left):
                    return look()
        return found

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: Time
    ) -> Future[TransformStamped]:
        """A future of the transform; it is done as soon as the buffer has the transform."""
        return self._future(
            lambda: self.can_transform_core(target_frame, source_frame, time),
            lambda: self.lookup_transform_core(target_frame, source_frame, time),
        )

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
    ) -> Future[TransformStamped]:
        """As `wait_for_transform_async`, for `lookup_transform_full`."""
        where = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._future(
            lambda: self.can_transform_full_core(*where),
            lambda: self.lookup_transform_full_core(*where),
        )

    def _future(
        self, look: Callable[[], tuple[bool, str]], get: Callable[[], TransformStamped]
    ) -> Future[TransformStamped]:
        future: Future[TransformStamped] = Future()

        def look_again() -> None:
            if future.done() or future.cancelled():
                return
            try:
                if look()[0]:
                    future.set_result(get())
            except Exception as error:
                future.set_exception(error)

        def forget(_: Future[TransformStamped]) -> None:
            with self._news:
                if look_again in self._waiters:
                    self._waiters.remove(look_again)

        with self._news:
            self._waiters.append(look_again)
        future.add_done_callback(forget)
        look_again()  # after it was added, so that no transform is missed between the two
        return future
