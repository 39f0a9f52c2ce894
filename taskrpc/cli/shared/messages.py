"""Messages and requests from a command line whose time stamps may be the time of sending."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, TypeAlias

from taskrpc.cli.shared.command import hinted
from taskrpc.cli.shared.quoting import NotAMapping
from taskrpc.cli.shared.values import from_fields, read_fields
from taskrpc.errors import InvalidRequest, TaskRpcError
from taskrpc.spi import read_text

if TYPE_CHECKING:
    from collections.abc import Callable

    Step: TypeAlias = Callable[[Any], Any]

_HEADER = "std_msgs/msg/Header"
_TIME = "builtin_interfaces/msg/Time"


class Template:
    """A message from a command line; `auto` for a header and `now` for a time become its time."""

    def __init__(self, cls: Any, values: Sequence[str]) -> None:
        self.cls = cls
        try:
            fields = read_fields(cls, values)
        except NotAMapping as error:
            problem = "The passed value needs to be a dictionary in YAML format"
            raise hinted(InvalidRequest("", problem), *error.__notes__) from None
        stamps = list(_take_stamps(cls, fields))
        self._message = from_fields(cls, fields)
        self._stamps = [_followed(self._message, steps) for steps in stamps]

    def message(self) -> Any:
        """Return the message with the current time in its `auto` and `now` fields."""
        seconds, nanoseconds = divmod(time.time_ns(), 10**9)
        for stamp in self._stamps:
            stamp.sec, stamp.nanosec = seconds, nanoseconds
        return self._message


def documents(path: str) -> list[str]:
    """Return the YAML documents of a file as texts, without empty ones. Raises TaskRpcError."""
    import yaml

    from taskrpc.spi import yaml_text

    try:
        text = read_text(path)
        found = yaml_text.compose_all(text)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "expected UTF-8 text"
        raise TaskRpcError(f"cannot read {path}: {reason}") from None
    except yaml.YAMLError as error:
        raise TaskRpcError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from None
    return [
        text[node.start_mark.index : node.end_mark.index]
        for node in found
        if node is not None and not node.tag.endswith(":null")
    ]


def _take_stamps(cls: Any, fields: dict[str, Any]) -> Iterator[tuple[Step, ...]]:
    """Replace `auto` and `now` by empty messages; yields the path to each time stamp."""
    attributes = dict(zip((name for name, _ in cls._FIELDS), cls.__struct_fields__, strict=True))
    for name, value in fields.items():
        nested = cls._NESTED.get(name)
        if nested is None:
            continue
        step: Step = attrgetter(attributes[name])
        if value == "auto" and nested._TYPE == _HEADER:
            fields[name] = {}
            yield step, attrgetter("stamp")
        elif value == "now" and nested._TYPE == _TIME:
            fields[name] = {}
            yield (step,)
        elif isinstance(value, dict):
            yield from ((step, *steps) for steps in _take_stamps(nested, value))
        elif isinstance(value, list):
            for index, each in enumerate(value):
                if isinstance(each, dict):
                    item: Step = itemgetter(index)
                    yield from ((step, item, *steps) for steps in _take_stamps(nested, each))


def _followed(message: Any, steps: Sequence[Step]) -> Any:
    for step in steps:
        message = step(message)
    return message
