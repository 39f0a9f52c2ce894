"""The base class of events."""

from __future__ import annotations


class Event:
    """Something that happened, or that a part of the launch file asks for."""

    name = "Event"
    """The event's name in descriptions."""
