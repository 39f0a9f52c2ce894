"""InteractiveMarkerServer: publishes markers, and calls back when a user moves or clicks them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Header
from visualization_msgs.msg import (
    InteractiveMarkerFeedback,
    InteractiveMarkerPose,
    InteractiveMarkerUpdate,
)
from visualization_msgs.srv import GetInteractiveMarkers

if TYPE_CHECKING:
    from taskrpc.ros.packages.rclpy.duration import Duration
else:
    from rclpy.duration import Duration

Callback = Callable[[Any], object]

_SOLE_USE = Duration(seconds=1.0)
"""While one view moves a marker, feedback of other views is ignored for so long."""


@dataclass
class _Change:
    """A change that `applyChanges` makes; one without a marker and a pose erases."""

    marker: Any = None
    """The new or replaced marker."""
    pose: Any = None
    """The new pose of the marker, and the header for it."""
    header: Any = None

    @property
    def erases(self) -> bool:
        """Whether it removes the marker."""
        return self.marker is None and self.pose is None


@dataclass
class _Use:
    """The callbacks of a marker, and the view that used it last."""

    callbacks: dict[int, Callback] = field(default_factory=dict)
    client: str = ""
    at: Any = None


class InteractiveMarkerServer:
    """Shows markers in views such as rviz2; changes are sent by `applyChanges`.

    Args:
        node: the node of its service and its topics.
        topic_ns: their namespace: `update`, `feedback` and `get_interactive_markers`.
        q_size: how many messages the topics keep.
    """

    DEFAULT_FEEDBACK_CALLBACK = 255

    def __init__(self, node: Any, topic_ns: str, q_size: int = 100) -> None:
        self.node = node
        self.topic_ns = topic_ns
        self.seq_num = 0
        self._lock = threading.RLock()
        self._markers: dict[str, Any] = {}
        self._changes: dict[str, _Change] = {}
        self._uses: dict[str, _Use] = {}
        self._service = node.create_service(
            GetInteractiveMarkers,
            f"{topic_ns}/get_interactive_markers",
            self.getInteractiveMarkersCallback,
        )
        self._updates = node.create_publisher(InteractiveMarkerUpdate, f"{topic_ns}/update", q_size)
        self._feedback = node.create_subscription(
            InteractiveMarkerFeedback, f"{topic_ns}/feedback", self.processFeedback, q_size
        )

    def shutdown(self) -> None:
        """Remove all markers, the service and the topics; call it before the node's end."""
        self.clear()
        self.applyChanges()
        self.node.destroy_service(self._service)
        self.node.destroy_publisher(self._updates)
        self.node.destroy_subscription(self._feedback)

    def insert(
        self,
        marker: Any,
        *,
        feedback_callback: Callback | None = None,
        feedback_type: int = DEFAULT_FEEDBACK_CALLBACK,
    ) -> None:
        """Add or replace a marker, and set a callback for it."""
        with self._lock:
            self._changes[marker.name] = _Change(marker=marker)
            if feedback_callback is not None:
                self.setCallback(marker.name, feedback_callback, feedback_type)

    def setPose(self, name: str, pose: Any, header: Any = None) -> bool:
        """Move a marker; False if there is none, or if it was inserted since `applyChanges`.

        A header without a frame keeps the marker's own.
        """
        with self._lock:
            change = self._changes.get(name)
            if name not in self._markers or (change is not None and change.marker is not None):
                return False
            is_kept = header is None or not header.frame_id
            kept = self._markers[name].header if is_kept else header
            self._changes[name] = _Change(pose=pose, header=kept)
            return True

    def erase(self, name: str) -> bool:
        """Remove a marker; False if there is none."""
        with self._lock:
            if name not in self._markers and name not in self._changes:
                return False
            self._changes[name] = _Change()
            return True

    def clear(self) -> None:
        """Remove all markers."""
        with self._lock:
            self._changes = {name: _Change() for name in self._markers}

    def setCallback(
        self,
        name: str,
        feedback_callback: Callback | None,
        feedback_type: int = DEFAULT_FEEDBACK_CALLBACK,
    ) -> bool:
        """Set the callback of a marker for one type of feedback, or for all others; None for none.

        False if there is no such marker.
        """
        with self._lock:
            if name not in self._markers and name not in self._changes:
                return False
            callbacks = self._uses.setdefault(name, _Use()).callbacks
            callbacks.pop(feedback_type, None)
            if feedback_callback is not None:
                callbacks[feedback_type] = feedback_callback
            return True

    def applyChanges(self) -> None:
        """Make the changes since the last call, and publish them."""
        with self._lock:
            changes, self._changes = self._changes, {}
            if not changes:
                return
            self.seq_num += 1
            update = InteractiveMarkerUpdate(type=InteractiveMarkerUpdate.UPDATE)
            for name, change in changes.items():
                self._apply(name, change, update)
        self.publish(update)

    def _apply(self, name: str, change: _Change, update: Any) -> None:
        if change.marker is not None:
            self._markers[name] = change.marker
            update.markers.append(change.marker)
        elif not change.erases:
            marker = self._markers[name]
            marker.pose, marker.header = change.pose, change.header
            moved = InteractiveMarkerPose(name=name, pose=change.pose, header=change.header)
            update.poses.append(moved)
        else:
            self._uses.pop(name, None)
            if self._markers.pop(name, None) is not None:
                update.erases.append(name)

    def get(self, name: str) -> Any:
        """A copy of a marker, with the changes that are not yet applied; None if there is none."""
        with self._lock:
            change = self._changes.get(name)
            if change is not None and change.marker is not None:
                return deepcopy(change.marker)
            if name not in self._markers or (change is not None and change.erases):
                return None
            marker = deepcopy(self._markers[name])
            if change is not None:
                marker.pose, marker.header = deepcopy(change.pose), deepcopy(change.header)
            return marker

    def processFeedback(self, feedback: Any) -> None:
        """Move the marker as a user did, and call the program's callback."""
        with self._lock:
            name, now = feedback.marker_name, self.node.get_clock().now()
            if name not in self._markers:
                return
            use = self._uses.setdefault(name, _Use())
            if use.client != feedback.client_id and use.at and now - use.at < _SOLE_USE:
                self.node.get_logger().debug(
                    f"ignored feedback of {feedback.client_id} for the marker {name},"
                    f" because {use.client} has used it less than a second ago"
                )
                return
            use.client, use.at = feedback.client_id, now
            if feedback.event_type == InteractiveMarkerFeedback.POSE_UPDATE:
                self._move(name, feedback)
            callback = use.callbacks.get(feedback.event_type) or use.callbacks.get(
                self.DEFAULT_FEEDBACK_CALLBACK
            )
        if callback is not None:
            callback(feedback)

    def _move(self, name: str, feedback: Any) -> None:
        stamp = self._markers[name].header.stamp
        follows_frame = not (stamp.sec or stamp.nanosec)
        self.setPose(name, feedback.pose, Header() if follows_frame else feedback.header)

    def publish(self, update: Any) -> None:
        """Publish an update."""
        update.server_id, update.seq_num = self.topic_ns, self.seq_num
        self._updates.publish(update)

    def getInteractiveMarkersCallback(self, request: Any, response: Any) -> Any:
        """Answer a view that asks for all markers."""
        del request
        with self._lock:
            response.sequence_number = self.seq_num
            response.markers = [deepcopy(marker) for marker in self._markers.values()]
        return response
