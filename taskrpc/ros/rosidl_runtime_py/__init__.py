"""Messages to and from dicts and YAML, and classes of interfaces by their names."""

from .convert import message_to_csv, message_to_ordereddict, message_to_yaml
from .set_message import set_message_fields

__all__ = [
    "message_to_csv",
    "message_to_ordereddict",
    "message_to_yaml",
    "set_message_fields",
]
