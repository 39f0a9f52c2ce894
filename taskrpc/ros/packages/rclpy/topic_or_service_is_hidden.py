"""Checks whether a name is hidden, so that listings omit it by default."""

from __future__ import annotations

from taskrpc.spi import names

HIDDEN_TOPIC_PREFIX = "_"
"""The prefix of a token that makes a name hidden."""

TOPIC_SEPARATOR_STRING = "/"
"""Separates the tokens of a name."""


def topic_or_service_is_hidden(name: str) -> bool:
    """Whether a token of the name begins with `_`."""
    return names.is_hidden(name)
