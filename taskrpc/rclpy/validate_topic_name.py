"""Whether a topic or service name can be expanded for a node."""

from __future__ import annotations

from taskrpc import names
from taskrpc.errors import InvalidName

from ._impl.graph.names import kind_of, refuse_other_than_text, translated


def validate_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True for a valid name, relative or not, with `~` and `{}` in it.

    Raises InvalidTopicNameException, or InvalidServiceNameException where it is a service's.
    """
    refuse_other_than_text(name, kind_of(is_service))
    try:
        names.check_unexpanded(name, kind_of(is_service))
    except InvalidName as error:
        raise translated(error) from None
    return True
