"""Prints how late the transforms arrive: `taskrpc run tf2_ros tf2_monitor`."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from tf2_msgs.msg import TFMessage

from .buffer import Buffer
from .transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener

_PERIOD = 0.5
_REPORTS_EVERY = 20
"""Periods between two reports: 10 seconds."""
_NOBODY = "<no authority available>"
"""Printed in place of a sender's name, because messages do not contain it."""


class Delays:
    """The delays of the last 1,000 messages of each frame, and of all messages together."""

    def __init__(self) -> None:
        self._by_frame: dict[str, deque[float]] = {}
        self._by_message: deque[tuple[float, float]] = deque(maxlen=1000)
        """When each message came, and its mean delay."""

    def add(self, now: float, stamps: Mapping[str, float]) -> None:
        """Count a message.

        Args:
            now: the present time, in seconds.
            stamps: the times of its transforms, by child frame.
        """
        delays = [now - stamp for stamp in stamps.values()]
        for frame, delay in zip(stamps, delays, strict=True):
            self._by_frame.setdefault(frame, deque(maxlen=1000)).append(delay)
        self._by_message.append((now, sum(delays) / max(1, len(delays))))

    def report(self, frames: Iterable[str] | None = None) -> str:
        """The lines for these frames (None: for all), and for all senders together."""
        wanted = None if frames is None else set(frames)
        lines = ["", "Frames:"]
        for frame, delays in sorted(self._by_frame.items()):
            if wanted is None or frame in wanted:
                lines.append(
                    f"Frame: {frame}, published by {_NOBODY}, Average Delay: {_mean(delays):g},"
                    f" Max Delay: {max(0, *delays):g}"
                )
        lines += ["", "All Broadcasters:"]
        if self._by_message:
            (first, _), (last, _) = self._by_message[0], self._by_message[-1]
            rate = len(self._by_message) / max(1e-8, last - first)
            means = [delay for _, delay in self._by_message]
            lines.append(
                f"Node: {_NOBODY} {rate:g} Hz, Average Delay: {_mean(means):g}"
                f" Max Delay: {max(0, *means):g}"
            )
        return "\n".join(lines)


def _mean(values: Any) -> float:
    return float(sum(values) / len(values))


class Monitor(Node):
    """The node `tf2_monitor`.

    Args:
        frames: the two frames between which delays are measured; empty for all frames.
    """

    def __init__(self, frames: list[str]) -> None:
        super().__init__("tf2_monitor")
        self._frames = frames
        self._delays = Delays()
        self._chain: list[str] = []
        self._mean_delay = self._longest_delay = 0.0
        self._periods = 0
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, self)
        static = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for topic, qos in ((DEFAULT_TF_TOPIC, 100), (DEFAULT_STATIC_TF_TOPIC, static)):
            self.create_subscription(TFMessage, topic, self._count, qos)
        self._timer = self.create_timer(_PERIOD, self.watch)
        if not frames:
            print("Gathering data on all frames for 10 seconds...", flush=True)

    def _count(self, message: Any) -> None:
        stamps = {
            each.child_frame_id: each.header.stamp.sec + each.header.stamp.nanosec / 1e9
            for each in message.transforms
        }
        self._delays.add(self._now(), stamps)

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds / 1e9)

    def watch(self) -> None:
        """Measure the delay between the frames; print a report every 10 seconds."""
        if self._frames and not self._measure():
            return
        self._periods += 1
        if self._periods % _REPORTS_EVERY:
            return
        print("\n\n")
        if self._frames:
            print(f"RESULTS: for {self._frames[0]} to {self._frames[1]}")
            print(f"Chain is: {' -> '.join(self._chain)}")
            print(f"Net delay     avg = {self._mean_delay:g}: max = {self._longest_delay:g}")
        else:
            print("RESULTS: for all Frames")
        print(self._delays.report(self._chain if self._frames else None), flush=True)

    def _measure(self) -> bool:
        """Measure the delay of the transform; False if the transform is unknown."""
        first, second = self._frames
        found, why_not = self._buffer.can_transform_core(first, second, Time())
        if not found:
            print(f"Waiting for transform {first} ->  {second}: {why_not}", flush=True)
            return False
        if not self._chain:
            self._chain = self._buffer.chain(second, Time(), first, Time(), second)
            print(f"Gathering data on {first} -> {second} for 10 seconds...", flush=True)
        stamp = self._buffer.lookup_transform_core(first, second, Time()).header.stamp
        delay = self._now() - stamp.sec - stamp.nanosec / 1e9
        self._mean_delay += 0.01 * (delay - self._mean_delay)
        self._longest_delay = max(self._longest_delay, delay)
        return True


def main(args: list[str] | None = None) -> None:
    """Print reports until Ctrl-C."""
    frames = remove_ros_args(sys.argv if args is None else args)[1:]
    if len(frames) not in (0, 2):
        print("TF_Monitor: usage: tf2_monitor framea frameb")
        sys.exit(1)
    try:
        with rclpy.init(args=args):
            rclpy.spin(Monitor(frames))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
