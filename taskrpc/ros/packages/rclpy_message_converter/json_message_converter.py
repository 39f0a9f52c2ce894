"""Converts messages to JSON and back."""

from __future__ import annotations

import base64
import json
from typing import Any

from .message_converter import (
    convert_dictionary_to_ros_message,
    convert_ros_message_to_dictionary,
)


def convert_json_to_ros_message(
    message_type: Any,
    json_message: str,
    kind: str = "message",
    strict_mode: bool = True,
    check_missing_fields: bool = False,
    check_types: bool = True,
) -> Any:
    """A message from JSON; the arguments are those of `convert_dictionary_to_ros_message`."""
    return convert_dictionary_to_ros_message(
        message_type,
        json.loads(json_message),
        kind,
        strict_mode,
        check_missing_fields,
        check_types,
    )


def convert_ros_message_to_json(message: Any) -> str:
    """A message as JSON; a byte becomes base64."""
    return json.dumps(
        convert_ros_message_to_dictionary(message),
        default=lambda value: base64.b64encode(value).decode("ascii"),
    )
