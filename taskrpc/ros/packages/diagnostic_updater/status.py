"""The message that a task fills in."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue


class DiagnosticStatusWrapper(DiagnosticStatus):
    """A `diagnostic_msgs/msg/DiagnosticStatus` with methods that fill it in."""

    def summary(self, *args: Any) -> None:
        """Set level and message: `summary(level, message)`, or those of another status."""
        self.level, self.message = _summary(args)

    def clearSummary(self) -> None:
        """Set level 0 and no message."""
        self.summary(DiagnosticStatus.OK, "")

    def mergeSummary(self, *args: Any) -> None:
        """Combine with another summary: the higher level, and the messages of all problems."""
        level, message = _summary(args)
        if (level > DiagnosticStatus.OK) == (self.level > DiagnosticStatus.OK):
            self.message = "; ".join(each for each in (self.message, message) if each)
        elif level > self.level:
            self.message = message
        self.level = max(self.level, level)

    def add(self, key: str, val: Any) -> None:
        """Add a value, as text."""
        self.values.append(KeyValue(key=key, value=str(val)))


def _summary(args: tuple[Any, ...]) -> tuple[bytes, str]:
    if len(args) == 1:
        return args[0].level, args[0].message
    level, message = args
    return level if isinstance(level, bytes) else bytes([level]), message


def checked_report(report: Any, task: str) -> Any:
    """The status that a task returned; raises TypeError for another value."""
    if not hasattr(report, "level"):
        raise TypeError(
            f"expected a DiagnosticStatusWrapper from the task {task!r}, got"
            f" {type(report).__name__}; is `return stat` missing at its end?"
        )
    return report
