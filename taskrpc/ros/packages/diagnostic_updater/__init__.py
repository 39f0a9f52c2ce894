"""Nodes report their state on `/diagnostics`, with the classes of ROS's `diagnostic_updater`.

An `Updater` runs tasks and publishes what they report. `tasks` has ready tasks, such as
`FrequencyStatus`; `publishers` has tasks that watch a publisher. Only programs import this package.
"""

from .publishers import DiagnosedPublisher, HeaderlessTopicDiagnostic, TopicDiagnostic
from .status import DiagnosticStatusWrapper
from .tasks import (
    CompositeDiagnosticTask,
    DiagnosticTask,
    FrequencyStatus,
    FrequencyStatusParam,
    FunctionDiagnosticTask,
    Heartbeat,
    TimeStampStatus,
    TimeStampStatusParam,
)
from .updater import DiagnosticTaskVector, Updater

__all__ = [
    "CompositeDiagnosticTask",
    "DiagnosedPublisher",
    "DiagnosticStatusWrapper",
    "DiagnosticTask",
    "DiagnosticTaskVector",
    "FrequencyStatus",
    "FrequencyStatusParam",
    "FunctionDiagnosticTask",
    "HeaderlessTopicDiagnostic",
    "Heartbeat",
    "TimeStampStatus",
    "TimeStampStatusParam",
    "TopicDiagnostic",
    "Updater",
]
