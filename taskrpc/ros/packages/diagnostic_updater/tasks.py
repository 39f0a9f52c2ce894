"""Tasks: each fills in one status when the updater runs it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from .status import DiagnosticStatusWrapper

_OK, _WARN, _ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class DiagnosticTask:
    """A task with a name; subclasses override `run`."""

    def __init__(self, name: str) -> None:
        self.name = name

    def getName(self) -> str:
        """The name."""
        return self.name

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        """Fill in a status and return it."""
        return stat


class FunctionDiagnosticTask(DiagnosticTask):
    """A task that calls a function with the status; the function returns it."""

    def __init__(self, name: str, fn: Callable[[Any], Any]) -> None:
        super().__init__(name)
        self.fn = fn

    def run(self, stat: DiagnosticStatusWrapper) -> Any:
        """Call the function."""
        return self.fn(stat)


class CompositeDiagnosticTask(DiagnosticTask):
    """Several tasks with one status: the highest level, and the messages of all problems."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.tasks: list[DiagnosticTask] = []

    def addTask(self, t: DiagnosticTask) -> None:
        """Add a task."""
        self.tasks.append(t)

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        """Run all tasks and combine their summaries."""
        level, message = stat.level, stat.message
        combined = DiagnosticStatusWrapper()
        for task in self.tasks:
            stat.summary(level, message)
            stat = task.run(stat)
            combined.mergeSummary(stat)
        stat.summary(combined)
        return stat


class FrequencyStatusParam:
    """The settings of `FrequencyStatus`.

    Args:
        freq_bound: the least and the greatest events a second: {"min": 9, "max": 11}.
        tolerance: the part by which a frequency may be beyond a bound.
        window_size: how many runs of the task one measurement spans.
    """

    def __init__(
        self, freq_bound: Mapping[str, float], tolerance: float = 0.1, window_size: int = 5
    ) -> None:
        self.freq_bound = freq_bound
        self.tolerance = tolerance
        self.window_size = window_size


class FrequencyStatus(DiagnosticTask):
    """Reports how often `tick` is called: a warning beyond the bounds, an error for never."""

    def __init__(
        self,
        params: FrequencyStatusParam,
        name: str = "FrequencyStatus",
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(name)
        self.params = params
        self.lock = threading.Lock()
        self._now = now
        self.clear()

    def clear(self) -> None:
        """Forget all events."""
        with self.lock:
            self.count = 0
            size = self.params.window_size
            self._past = deque([(self._now(), 0)] * size, maxlen=size)

    def tick(self) -> None:
        """Count an event."""
        with self.lock:
            self.count += 1

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        """Compare the events since the begin of the window with the bounds."""
        with self.lock:
            now, (then, before) = self._now(), self._past[0]
            events, window = self.count - before, now - then
            self._past.append((now, self.count))
        frequency = events / window if window else 0.0
        bound, tolerance = self.params.freq_bound, self.params.tolerance
        least = bound["min"] * (1 - tolerance)
        most = bound["max"] * (1 + tolerance) if "max" in bound else None
        if events == 0:
            stat.summary(_ERROR, "No events recorded.")
        elif frequency < least:
            stat.summary(_WARN, "Frequency too low.")
        elif most is not None and frequency > most:
            stat.summary(_WARN, "Frequency too high.")
        else:
            stat.summary(_OK, "Desired frequency met")
        stat.add("Events in window", f"{events}")
        stat.add("Events since startup", f"{self.count}")
        stat.add("Duration of window (s)", f"{window:f}")
        stat.add("Actual frequency (Hz)", f"{frequency:f}")
        if bound.get("max") == bound["min"]:
            stat.add("Target frequency (Hz)", f"{bound['min']:f}")
        if bound["min"] > 0:
            stat.add("Minimum acceptable frequency (Hz)", f"{least:f}")
        if most is not None:
            stat.add("Maximum acceptable frequency (Hz)", f"{most:f}")
        return stat


class TimeStampStatusParam:
    """The least and the greatest acceptable age of a time in seconds; for `TimeStampStatus`."""

    def __init__(self, min_acceptable: float = -1, max_acceptable: float = 5) -> None:
        self.max_acceptable = max_acceptable
        self.min_acceptable = min_acceptable


class TimeStampStatus(DiagnosticTask):
    """Reports the ages of the times given to `tick`: an error for times too old or too new."""

    def __init__(
        self,
        params: TimeStampStatusParam | None = None,
        name: str = "Timestamp Status",
        now: Callable[[], float] = time.time,
    ) -> None:
        super().__init__(name)
        self.params = TimeStampStatusParam() if params is None else params
        self.lock = threading.Lock()
        self._now = now
        self._ages: list[float] = []
        self._is_zero_seen = False
        self.early_count = self.late_count = self.zero_count = 0

    def tick(self, stamp: Any) -> None:
        """Take a time: seconds, a `rclpy.time.Time` or a message `Time`."""
        if hasattr(stamp, "nanoseconds"):
            stamp = stamp.nanoseconds / 1e9
        elif hasattr(stamp, "nanosec"):
            stamp = stamp.sec + stamp.nanosec / 1e9
        with self.lock:
            if stamp == 0:
                self._is_zero_seen = True
            else:
                self._ages.append(self._now() - stamp)

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        """Report the times since the last run."""
        with self.lock:
            ages, self._ages = self._ages, []
            is_zero_seen, self._is_zero_seen = self._is_zero_seen, False
        least, most = min(ages, default=0), max(ages, default=0)
        stat.summary(_OK, "Timestamps are reasonable.")
        if not ages and not is_zero_seen:
            stat.summary(_WARN, "No data since last update.")
        if least < self.params.min_acceptable:
            stat.summary(_ERROR, "Timestamps too far in future seen.")
            self.early_count += 1
        if most > self.params.max_acceptable:
            stat.summary(_ERROR, "Timestamps too far in past seen.")
            self.late_count += 1
        if is_zero_seen:
            stat.summary(_ERROR, "Zero timestamp seen.")
            self.zero_count += 1
        stat.add("Earliest timestamp delay:", f"{least:f}")
        stat.add("Latest timestamp delay:", f"{most:f}")
        stat.add("Earliest acceptable timestamp delay:", f"{self.params.min_acceptable:f}")
        stat.add("Latest acceptable timestamp delay:", f"{self.params.max_acceptable:f}")
        stat.add("Late diagnostic update count:", self.late_count)
        stat.add("Early diagnostic update count:", self.early_count)
        stat.add("Zero seen diagnostic update count:", self.zero_count)
        return stat


class Heartbeat(DiagnosticTask):
    """Reports that the node is alive."""

    def __init__(self) -> None:
        super().__init__("Heartbeat")

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        """Report level 0."""
        stat.summary(_OK, "Alive")
        return stat
