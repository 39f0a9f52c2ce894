"""Filters of log lines: `throttle_duration_sec=`, `skip_first=` and `once=`.

Programs may add their own filter classes to `supported_filters`. The state of a filter is in the
context, a dict for each place in the program that logs.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, ClassVar, TypeAlias

from ...clock import Clock

Context: TypeAlias = dict[str, Any]
"""The context of one place in a program that logs: name, severity, filters and their state."""


class LoggingFilter:
    """The base of filters; it passes every line."""

    params: ClassVar[dict[str, Any]] = {}
    """The options that select the filter, with their defaults; None marks a required option."""

    @classmethod
    def initialize_context(cls, context: Context, **kwargs: Any) -> None:
        """Store the options of a place in the program that logs for the first time.

        Raises TypeError for a required option that is missing.
        """
        for name, default in cls.params.items():
            value = kwargs.get(name, default)
            if value is None:
                raise TypeError(
                    f'Required parameter "{name}" was not specified for logging filter'
                    f' "{cls.__name__}"'
                )
            context[name] = value

    @staticmethod
    def should_log(context: Context) -> bool:
        """Whether the next line of the place may be logged."""
        return True


class Once(LoggingFilter):
    """Passes only the first line."""

    params: ClassVar[dict[str, Any]] = {"once": None}

    @classmethod
    def initialize_context(cls, context: Context, **kwargs: Any) -> None:
        """As `LoggingFilter.initialize_context`."""
        super().initialize_context(context, **kwargs)
        context["has_been_logged_once"] = False

    @staticmethod
    def should_log(context: Context) -> bool:
        """True the first time."""
        logged, context["has_been_logged_once"] = context["has_been_logged_once"], True
        return not logged


class Throttle(LoggingFilter):
    """Passes a line if enough time has elapsed since the last line that it passed."""

    params: ClassVar[dict[str, Any]] = {
        "throttle_duration_sec": None,
        "throttle_time_source_type": Clock(),
    }

    @classmethod
    def initialize_context(cls, context: Context, **kwargs: Any) -> None:
        """As `LoggingFilter.initialize_context`; raises ValueError if the clock is not a Clock."""
        super().initialize_context(context, **kwargs)
        clock = context["throttle_time_source_type"]
        if not isinstance(clock, Clock):
            raise ValueError(
                f'Received throttle_time_source_type of "{clock}" is not a clock instance'
            )
        context["throttle_last_logged"] = 0

    @staticmethod
    def should_log(context: Context) -> bool:
        """Whether enough time has elapsed on its clock."""
        now = context["throttle_time_source_type"].now().nanoseconds
        if now < context["throttle_last_logged"] + context["throttle_duration_sec"] * 1e9:
            return False
        context["throttle_last_logged"] = now
        return True


class SkipFirst(LoggingFilter):
    """Passes every line except the first."""

    params: ClassVar[dict[str, Any]] = {"skip_first": None}

    @classmethod
    def initialize_context(cls, context: Context, **kwargs: Any) -> None:
        """As `LoggingFilter.initialize_context`."""
        super().initialize_context(context, **kwargs)
        context["first_has_been_skipped"] = False

    @staticmethod
    def should_log(context: Context) -> bool:
        """False the first time."""
        skipped, context["first_has_been_skipped"] = context["first_has_been_skipped"], True
        return bool(skipped)


supported_filters: OrderedDict[str, type[LoggingFilter]] = OrderedDict(
    throttle=Throttle, skip_first=SkipFirst, once=Once
)
"""The filters in the order in which they are applied."""


def get_filters_from_kwargs(**kwargs: Any) -> list[str]:
    """The names of the filters that these options of a logging call select.

    Raises TypeError for an unknown option, and if an option needs another one that is missing.
    """
    wanted = []
    known: list[str] = []
    for kind, cls in supported_filters.items():
        known += cls.params
        if not any(kwargs.get(name) for name in cls.params):
            continue
        for name, default in cls.params.items():
            if kwargs.get(name, default) is None:
                raise TypeError(
                    f'required parameter "{name}" not specified but is required for the'
                    f' the logging filter "{kind}"'
                )
        wanted.append(kind)
    for name in kwargs:
        if name not in known:
            raise TypeError(
                f'parameter "{name}" is not one of the recognized logging options "{known}"'
            )
    return wanted
