"""Log formats: the call's number on each line, and one line of text or JSON for each record."""

from __future__ import annotations

import logging
import re
from typing import IO, Any

from taskrpc.core.callinfo import answered_call, log_fields

CALL_FIELDS = ("call", "service", "caller", "principal")
"""The attributes that a `CallFilter` gives to each log record."""

STYLES = ("text", "json")

# All control characters except the tab, and those that reverse the direction of writing.
_CONTROL = re.compile(r"[\x00-\x08\n-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


class CallFilter(logging.Filter):
    """Adds the call to each record that a service callback logs.

    Add it to a handler: `handler.addFilter(taskrpc.logs.CallFilter())`. Then the handler's format
    may contain `%(call)s`, `%(service)s`, `%(caller)s` and `%(principal)s`; the last one is the
    caller's account. All are empty in records that belong to no call.
    """

    def __init__(self) -> None:
        super().__init__()

    def filter(self, record: logging.LogRecord) -> bool:
        """Add the fields that the record does not have; returns True for every record."""
        call = None if hasattr(record, "call") else answered_call()
        known = log_fields(call) if call is not None else {}
        for name in CALL_FIELDS:
            if not hasattr(record, name):
                setattr(record, name, known.get(name, ""))
        return True


class TextFormatter(logging.Formatter):
    """Formats each record as ROS 2 prints it, safe against text that callers have sent.

    A caller can neither forge a line nor control the terminal: control characters are written as
    `\\x1b`, and so are line breaks that are not in the program's own text. Further lines of a
    record are indented.
    """

    def __init__(self) -> None:
        super().__init__()

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, with the traceback below it if there is one."""
        text = record.getMessage()
        if not text.isprintable():
            parts = text.split("\n") if "\n" in str(record.msg) else [text]
            text = "\n  ".join(map(_escaped, parts))
        lines = [f"[{record.levelname}] [{record.created:.9f}] [{record.name}]: {text}"]
        if record.exc_info:
            lines += self.formatException(record.exc_info).splitlines()
        if record.stack_info:
            lines += self.formatStack(record.stack_info).splitlines()
        return "\n  ".join([lines[0], *map(_escaped, lines[1:])])


class JsonFormatter(logging.Formatter):
    """Formats each record as one line of JSON.

    Keys: `time` (UTC), `level`, `logger`, `message`; then the record's other fields, such as
    `call`, `service`, `caller`, `task` or an `extra` of your own; `error` with the whole traceback
    if there is one.
    """

    def __init__(self) -> None:
        super().__init__()
        usual = vars(logging.LogRecord("", 0, "", 0, "", (), None))
        self._usual = {*usual, "message", "asctime", "taskName"}

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, without a line break at its end."""
        fields = {
            "time": _utc(record.created),
            "level": record.levelname,
            "logger": record.name,
            "message": record.getMessage(),
            **{name: value for name, value in vars(record).items() if name not in self._usual},
        }
        if record.exc_info:
            fields["error"] = self.formatException(record.exc_info)
        if record.stack_info:
            fields["stack"] = self.formatStack(record.stack_info)
        shown = (
            f"{_encoded(name)}: {_encoded(value)}"
            for name, value in fields.items()
            if value != "" or name == "message"
        )
        return "{" + ", ".join(shown) + "}"


def handler(style: str = "text", stream: IO[str] | None = None) -> logging.Handler:
    """Return a handler for `logging.basicConfig(handlers=[...])`; it writes to stderr by default.

    `style` is `text` (as ROS 2 prints lines) or `json`. The handler has a `CallFilter`.

    Raises ValueError for another style.
    """
    if style not in STYLES:
        raise ValueError(f"style: expected 'text' or 'json', got {style!r}")
    made = logging.StreamHandler(stream)
    made.setFormatter(JsonFormatter() if style == "json" else TextFormatter())
    made.addFilter(CallFilter())
    return made


def _escaped(text: str) -> str:
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def _utc(created: float) -> str:
    from datetime import UTC, datetime  # servers that log text start without it

    moment = datetime.fromtimestamp(created, UTC)
    return moment.isoformat(timespec="microseconds").replace("+00:00", "Z")


def _encoded(value: Any) -> str:
    import json

    # Every value must give a line: NaN, lists that contain themselves and odd keys become text.
    try:
        return json.dumps(value, default=repr, allow_nan=False)
    except (ValueError, TypeError, RecursionError):
        return json.dumps(repr(value))
