"""Checks the name of a topic or service before expansion."""

from __future__ import annotations

from functools import partial

from taskrpc.spi import names

from ._impl.graph.names import checked, kind_of


def validate_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True for a valid name, which may be relative and contain `~` and `{}`.

    Raises InvalidTopicNameException, or InvalidServiceNameException for a service.
    """
    kind = kind_of(is_service)
    checked(kind, name, partial(names.check_unexpanded, kind=kind, repeated_slashes=True))
    return True
