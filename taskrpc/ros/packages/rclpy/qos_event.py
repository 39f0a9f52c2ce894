"""The old name of `event_handler`."""

from .event_handler import *  # noqa: F403
