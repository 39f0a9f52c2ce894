"""Whether listings leave a name out."""

from __future__ import annotations

from taskrpc import names

HIDDEN_TOPIC_PREFIX = "_"
"""What a token of a hidden name begins with."""

TOPIC_SEPARATOR_STRING = "/"
"""What stands between the tokens of a name."""


def topic_or_service_is_hidden(name: str) -> bool:
    """Whether a token of the name begins with `_`."""
    return names.is_hidden(name)
