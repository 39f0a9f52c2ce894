"""The name by which older programs know `event_handler`."""

from .event_handler import *  # noqa: F403
