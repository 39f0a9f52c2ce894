"""Tasks that watch how often a node publishes, and with which times."""

from __future__ import annotations

from typing import Any

from .tasks import (
    CompositeDiagnosticTask,
    DiagnosticTask,
    FrequencyStatus,
    FrequencyStatusParam,
    TimeStampStatus,
    TimeStampStatusParam,
)
from .updater import DiagnosticTaskVector


class HeaderlessTopicDiagnostic(CompositeDiagnosticTask):
    """Watches how often `tick` is called, for a topic whose messages have no header."""

    def __init__(self, name: str, diag: DiagnosticTaskVector, freq: FrequencyStatusParam) -> None:
        super().__init__(f"{name} topic status")
        self.diag = diag
        self.freq = FrequencyStatus(freq)
        self.addTask(self.freq)
        self.diag.add(self)

    def tick(self) -> None:
        """Count a message."""
        self.freq.tick()

    def addTask(self, t: DiagnosticTask) -> None:
        """Add a task to the same report."""
        super().addTask(t)

    def clear_window(self) -> None:
        """Forget all messages."""
        self.freq.clear()


class TopicDiagnostic(HeaderlessTopicDiagnostic):
    """Watches how often `tick` is called, and the times in the headers."""

    def __init__(
        self,
        name: str,
        diag: DiagnosticTaskVector,
        freq: FrequencyStatusParam,
        stamp: TimeStampStatusParam,
    ) -> None:
        super().__init__(name, diag, freq)
        self.stamp = TimeStampStatus(stamp)
        self.addTask(self.stamp)

    def tick(self, stamp: Any = None) -> None:
        """Count a message with this time."""
        super().tick()
        if stamp is not None:
            self.stamp.tick(stamp)


class DiagnosedPublisher(TopicDiagnostic):
    """A publisher of messages with headers that watches itself.

    Args:
        pub: a publisher of rclpy.
    """

    def __init__(
        self,
        pub: Any,
        diag: DiagnosticTaskVector,
        freq: FrequencyStatusParam,
        stamp: TimeStampStatusParam,
    ) -> None:
        super().__init__(pub.topic_name, diag, freq, stamp)
        self.publisher = pub

    def publish(self, message: Any) -> None:
        """Publish a message and count it."""
        self.tick(message.header.stamp)
        self.publisher.publish(message)
