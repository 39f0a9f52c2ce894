"""The types of fields, as in `SLOT_TYPES` of a message class."""

from srvgen.classes.slot_types import *  # noqa: F403
