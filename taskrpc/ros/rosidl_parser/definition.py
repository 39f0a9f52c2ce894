"""The types of fields, as `SLOT_TYPES` of a message class holds them."""

from srvgen.classes.slot_types import *  # noqa: F403
