"""The frame tree with the messages and times of ROS, for use from several threads."""

from __future__ import annotations

import sys
import threading
from typing import TYPE_CHECKING, Any

from .descriptions import as_dot, as_yaml
from .frame_tree import DEFAULT_CACHE_TIME, FrameTree
from .geometry import Transform

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped

_SECOND = 1_000_000_000


def nanoseconds_of(time: Any, kind: str = "time") -> int:
    """The nanoseconds of a time or duration, which is one of rclpy or a message.

    Raises:
        TypeError: it is neither.
    """
    if isinstance(time, type):
        raise TypeError(f"{kind} is the class {time.__name__} itself; write {time.__name__}()")
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return int(time.sec) * _SECOND + int(time.nanosec)
    if hasattr(time, "nanoseconds"):
        return int(time.nanoseconds)
    raise TypeError(
        f"{kind} must have sec and nanosec, or nanoseconds; got {type(time).__qualname__}"
    )


class BufferCore:
    """The transforms that were received, without waiting for others.

    Args:
        cache_time: a duration: how long transforms are kept. The default is 10 seconds.
    """

    def __init__(self, cache_time: Any = None) -> None:
        kept = DEFAULT_CACHE_TIME
        if cache_time is not None:
            kept = nanoseconds_of(cache_time, "duration")
        self._tree = FrameTree(kept)
        self._tree_lock = threading.Lock()

    def set_transform(self, transform: Any, authority: str) -> None:
        """Store a TransformStamped; report an invalid one on stderr, as tf2 does."""
        self._set(transform, authority, is_static=False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Store a static TransformStamped."""
        self._set(transform, authority, is_static=True)

    def _set(self, message: Any, authority: str, *, is_static: bool) -> None:
        time = nanoseconds_of(message.header.stamp)
        moved, turned = message.transform.translation, message.transform.rotation
        transform = Transform(
            (float(moved.x), float(moved.y), float(moved.z)),
            (float(turned.x), float(turned.y), float(turned.z), float(turned.w)),
        )
        parent, child = message.header.frame_id, message.child_frame_id
        with self._tree_lock:
            refused = self._tree.set(parent, child, time, transform, authority, is_static=is_static)
        for reason in refused:
            prefix = "Warning: " if reason.startswith("TF_OLD_DATA") else "Error:   "
            print(prefix + reason, file=sys.stderr)

    def clear(self) -> None:
        """Forget all transforms that are not static."""
        with self._tree_lock:
            self._tree.clear()

    # Lookups

    def lookup_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> TransformStamped:
        """The TransformStamped from the source frame to the target frame, at a time.

        Time 0 asks for the latest common time. Raises TransformException.
        """
        with self._tree_lock:
            found = self._tree.lookup(target_frame, source_frame, nanoseconds_of(time))
        return _stamped(target_frame, source_frame, *found)

    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> TransformStamped:
        """As `lookup_transform_core`, from one time to another by a frame that stays fixed."""
        times = nanoseconds_of(target_time), nanoseconds_of(source_time)
        with self._tree_lock:
            found = self._tree.lookup_full(
                target_frame, times[0], source_frame, times[1], fixed_frame
            )
        return _stamped(target_frame, source_frame, *found)

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[bool, str]:
        """Whether `lookup_transform_core` would succeed, and otherwise why not."""
        with self._tree_lock:
            why_not = self._tree.obstacle(target_frame, source_frame, nanoseconds_of(time))
        return not why_not, why_not

    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> tuple[bool, str]:
        """Whether `lookup_transform_full_core` would succeed, and otherwise why not."""
        times = nanoseconds_of(target_time), nanoseconds_of(source_time)
        with self._tree_lock:
            why_not = self._tree.obstacle_full(
                target_frame, times[0], source_frame, times[1], fixed_frame
            )
        return not why_not, why_not

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Any:
        """The latest time of rclpy at which the transform is known. Raises TransformException."""
        from rclpy.time import Time

        with self._tree_lock:
            found = self._tree.latest_common_time(target_frame, source_frame)
        return Time(nanoseconds=found)

    # All frames

    def all_frames_as_yaml(self) -> str:
        """All frames with their parents, senders, rates and times."""
        with self._tree_lock:
            return as_yaml(self._tree)

    def all_frames_as_string(self) -> str:
        """All frames with their parents, one on each line."""
        with self._tree_lock:
            return self._tree.as_string()

    def chain(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> list[str]:
        """The names of the frames from the source to the target. Raises TransformException."""
        times = nanoseconds_of(target_time), nanoseconds_of(source_time)
        with self._tree_lock:
            return self._tree.chain(target_frame, times[0], source_frame, times[1], fixed_frame)

    _chain = chain  # ROS's name

    def _frameExists(self, frame_id: str) -> bool:
        with self._tree_lock:
            return self._tree.knows(frame_id)

    def _getFrameStrings(self) -> list[str]:
        with self._tree_lock:
            return self._tree.names()

    def _allFramesAsDot(self, time: Any = None) -> str:
        with self._tree_lock:
            return as_dot(self._tree, 0 if time is None else nanoseconds_of(time))


def _stamped(target: str, source: str, transform: Transform, time: int) -> TransformStamped:
    from geometry_msgs.msg import TransformStamped

    message = TransformStamped(child_frame_id=source)
    message.header.frame_id = target
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time, _SECOND)
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = transform.translation
    turned.x, turned.y, turned.z, turned.w = transform.rotation
    return message
