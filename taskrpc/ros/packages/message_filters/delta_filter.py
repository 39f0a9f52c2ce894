"""Filters that pass on only the messages of which a field has changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from .filters import SimpleFilter

FieldGetter = Callable[[Any], Any]


class ComparisonHandler:
    """Decides which messages a `ComparisonFilter` passes on."""

    def message_fits(self, message: Any) -> bool:
        """Whether to pass a message on."""
        raise NotImplementedError

    def do_fields_fit(self, field_a: Any, field_b: Any) -> bool:
        """Whether two values of a field let their message pass."""
        raise NotImplementedError


class CachedComparisonHandler(ComparisonHandler):
    """Compares the fields of a message with those of the message that passed last.

    A class that inherits from it sets `_field_getters` and has `do_fields_fit`.
    """

    _field_getters: Sequence[FieldGetter] = ()

    def __init__(self) -> None:
        self._last: Any = None

    def message_fits(self, message: Any) -> bool:
        """Whether it is the first message, or one of its fields fits."""
        last = self._last
        fits = last is None or any(
            self.do_fields_fit(get(last), get(message)) for get in self._field_getters
        )
        if fits:
            self._last = message
        return fits

    def do_fields_fit(self, field_a: Any, field_b: Any) -> bool:
        """Raise NotImplementedError."""
        kind = type(self).__name__
        raise NotImplementedError(f"{kind} must have a method do_fields_fit(field_a, field_b)")


class DeltaCompare(CachedComparisonHandler):
    """Lets a message pass if one of its fields differs; a field is a number, a text or a bool."""

    def __init__(self, field_getters: Sequence[FieldGetter]) -> None:
        super().__init__()
        self._field_getters = field_getters

    def do_fields_fit(self, val_a: Any, val_b: Any) -> bool:
        """Whether two values differ. Raises TypeError for lists and messages."""
        if not all(isinstance(value, bool | int | float | str) for value in (val_a, val_b)):
            raise TypeError(f"Unable to compare fields of types {type(val_a)} and {type(val_b)}")
        return bool(val_a != val_b)


class ComparisonFilter(SimpleFilter):
    """Passes on the messages that fit.

    Args:
        comparison_handler: decides which messages fit.
        message_filter: the filter whose messages it gets.
    """

    def __init__(
        self, comparison_handler: ComparisonHandler, message_filter: SimpleFilter | None = None
    ) -> None:
        super().__init__()
        self._comparison_handler = comparison_handler
        self.incoming_connection: int | None = None
        self.connectInput(message_filter)

    def connectInput(self, message_filter: SimpleFilter | None) -> None:
        """Take the messages of a filter; possible only once."""
        if self.incoming_connection is not None:
            raise RuntimeError(
                "This instance of ComparisonFilter already has an incoming connection"
            )
        if message_filter is not None:
            self.incoming_connection = message_filter.registerCallback(self.add)

    def add(self, message: Any) -> None:
        """Pass on a message if it fits."""
        if self.message_fits(message):
            self.signalMessage(message)

    def message_fits(self, message: Any) -> bool:
        """Whether the handler lets a message pass."""
        return self._comparison_handler.message_fits(message)


class DeltaFilter(ComparisonFilter):
    """Passes on the messages in which a field differs from the message that passed last.

    Args:
        field_getters: each returns a field of a message.
        message_filter: the filter whose messages it gets.
    """

    def __init__(
        self, field_getters: Sequence[FieldGetter], message_filter: SimpleFilter | None = None
    ) -> None:
        super().__init__(DeltaCompare(field_getters), message_filter)


class PathDeltaFilter(DeltaFilter):
    """As `DeltaFilter`, with the fields as paths such as `pose.position.x`."""

    def __init__(
        self, field_path_list: Sequence[str], message_filter: SimpleFilter | None = None
    ) -> None:
        getters = [partial(self.get_field_by_path, field_path=path) for path in field_path_list]
        super().__init__(getters, message_filter)

    def get_field_by_path(self, message: Any, field_path: str) -> Any:
        """The field of a message at a path. Raises RuntimeError if there is none."""
        found = message
        for name in field_path.split("."):
            parent, found = found, getattr(found, name, None)
            if found is None:
                raise RuntimeError(
                    f"Unable to access field {name!r} of {type(parent).__name__}"
                    f" (full path: {field_path!r})"
                )
        return found
