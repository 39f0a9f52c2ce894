"""The base class of events."""

from __future__ import annotations


class Event:
    """Something that has happened, or a request from a part of the launch file."""

    name = "Event"
    """The event's name in descriptions."""
