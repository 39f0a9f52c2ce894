"""Filters between subscriptions and callbacks, with the classes of ROS's `message_filters`.

A filter passes messages to the callbacks that `registerCallback` adds. `matching` decides which
messages belong together; `filters` has the classes. Only programs
import this package.
"""

from .filters import (
    ApproximateTimeSynchronizer,
    Cache,
    Chain,
    SimpleFilter,
    Subscriber,
    TimeSynchronizer,
)

__all__ = [
    "ApproximateTimeSynchronizer",
    "Cache",
    "Chain",
    "SimpleFilter",
    "Subscriber",
    "TimeSynchronizer",
]
