"""Finds the conversion for a type of message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

_to_numpy: dict[tuple[type, bool], Callable[..., Any]] = {}
_from_numpy: dict[tuple[type, bool], Callable[..., Any]] = {}


def converts_to_numpy(msgtype: type, plural: bool = False) -> Callable[[F], F]:
    """A decorator: the function converts a message, or with `plural` a list of messages."""
    return _registered(_to_numpy, msgtype, plural)


def converts_from_numpy(msgtype: type, plural: bool = False) -> Callable[[F], F]:
    """A decorator: the function converts an array to a message, or to a list of messages."""
    return _registered(_from_numpy, msgtype, plural)


def numpify(msg: Any, *args: Any, **kwargs: Any) -> Any:
    """The array of a message or of a list of messages; None for None and for an empty list.

    Raises:
        ValueError: there is no conversion for the type.
    """
    if msg is None or (isinstance(msg, list) and not msg):
        return None
    plural = isinstance(msg, list)
    msgtype = type(msg[0] if plural else msg)
    return _found(_to_numpy, msgtype, plural)(msg, *args, **kwargs)


def msgify(msg_type: type, numpy_obj: Any, *args: Any, **kwargs: Any) -> Any:
    """The message of an array; None for None.

    Raises:
        ValueError: there is no conversion for the type.
    """
    if numpy_obj is None:
        return None
    plural = kwargs.pop("plural", False)
    return _found(_from_numpy, msg_type, plural)(numpy_obj, *args, **kwargs)


def _registered(
    table: dict[tuple[type, bool], Callable[..., Any]], msgtype: type, plural: bool
) -> Callable[[F], F]:
    def decorator(function: F) -> F:
        table[msgtype, plural] = function
        return function

    return decorator


def _found(
    table: dict[tuple[type, bool], Callable[..., Any]], msgtype: type, plural: bool
) -> Callable[..., Any]:
    if (msgtype, plural) in table:
        return table[msgtype, plural]
    known = ", ".join(sorted(each.__name__ for each, several in table if several == plural))
    raise ValueError(
        f"Unable to convert message {msgtype.__name__}, only supports conversion to/from {known}"
    )
