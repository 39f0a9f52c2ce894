"""Types of the options and contexts of log calls, which programs use in annotations."""

from __future__ import annotations

from typing import TypedDict

from ...clock import Clock
from ...impl.logging_severity import LoggingSeverity


class RcutilsLoggerContext(TypedDict):
    """A context without the state of its filters, for annotations."""

    name: str
    severity: LoggingSeverity
    filters: list[str]


class OnceContext(RcutilsLoggerContext):
    """A context with the state of `Once`."""

    has_been_logged_once: bool


class ThrottleContext(RcutilsLoggerContext):
    """A context with the state of `Throttle`."""

    throttle_duration_sec: float
    throttle_time_source_type: Clock
    throttle_last_logged: int


class SkipFirstContext(RcutilsLoggerContext):
    """A context with the state of `SkipFirst`."""

    first_has_been_skipped: bool


class LoggingFilterArgs(TypedDict, total=False):
    """The options of a logging call that select filters, for annotations."""

    once: bool
    throttle_duration_sec: float
    throttle_time_source_type: Clock
    skip_first: bool


class LoggingFilterParams(TypedDict, total=False):
    """The options of one filter class."""

    once: bool | None
    throttle_duration_sec: float | None
    throttle_time_source_type: Clock
    skip_first: bool | None


class LoggingArgs(LoggingFilterArgs, total=False):
    """All options of `RcutilsLogger.log`."""

    name: str
