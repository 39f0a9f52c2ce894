"""Whether an absolute name may be a topic's or a service's."""

from __future__ import annotations

from functools import partial

from taskrpc import names

from ._impl.graph.names import checked, kind_of


def validate_full_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True for a valid absolute name, with nothing left to expand.

    Raises InvalidTopicNameException, or InvalidServiceNameException where it is a service's.
    """
    kind = kind_of(is_service)
    checked(kind, name, partial(names.check_absolute, kind=kind))
    return True
