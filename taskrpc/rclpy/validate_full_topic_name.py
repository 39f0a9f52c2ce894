"""Whether an absolute name may be a topic's or a service's."""

from __future__ import annotations

from taskrpc import names
from taskrpc.errors import InvalidName

from ._impl.graph.names import kind_of, refuse_other_than_text, translated


def validate_full_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True for a valid absolute name, with nothing left to expand.

    Raises InvalidTopicNameException, or InvalidServiceNameException where it is a service's.
    """
    refuse_other_than_text(name, kind_of(is_service))
    try:
        names.check_absolute(name, kind_of(is_service))
    except InvalidName as error:
        raise translated(error) from None
    return True
