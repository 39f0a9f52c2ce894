"""Whether a topic or service name can be expanded for a node."""

from __future__ import annotations

from functools import partial

from taskrpc import names

from ._impl.graph.names import checked, kind_of


def validate_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True for a valid name, relative or not, with `~` and `{}` in it.

    Raises InvalidTopicNameException, or InvalidServiceNameException where it is a service's.
    """
    kind = kind_of(is_service)
    checked(kind, name, partial(names.check_unexpanded, kind=kind))
    return True
