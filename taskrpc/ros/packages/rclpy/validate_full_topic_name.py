"""Checks the absolute name of a topic or service."""

from __future__ import annotations

from functools import partial

from taskrpc.spi import names

from ._impl.graph.names import checked, kind_of


def validate_full_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True for a valid absolute name that needs no expansion.

    Raises InvalidTopicNameException, or InvalidServiceNameException for a service.
    """
    kind = kind_of(is_service)
    checked(kind, name, partial(names.check_absolute, kind=kind))
    return True
