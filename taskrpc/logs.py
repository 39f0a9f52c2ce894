"""Log lines that can be found again: the call's number on each, and lines of JSON."""

from __future__ import annotations

import logging
import re
from typing import IO, Any

from taskrpc.callinfo import answering, log_fields

CALL_FIELDS = ("call", "service", "caller", "principal")
"""The attributes that a `CallFilter` gives to each log record."""

STYLES = ("text", "json")

# Without the tab; with what turns the direction of writing round.
_STEERING = re.compile(r"[\x00-\x08\n-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


class CallFilter(logging.Filter):
    """Adds to each line that a service callback logs which call it belongs to.

    Give it to a handler: `handler.addFilter(taskrpc.logs.CallFilter())`. Then `%(call)s`,
    `%(service)s`, `%(caller)s` and `%(principal)s` may stand in the handler's format, the last is
    the account that the caller proved. All are empty in lines that belong to no call.
    """

    def __init__(self) -> None:
        super().__init__()

    def filter(self, record: logging.LogRecord) -> bool:
        """Fill in what the line does not say itself; lets every line pass."""
        call = None if hasattr(record, "call") else answering.get()
        known = log_fields(call) if call is not None else {}
        for name in CALL_FIELDS:
            if not hasattr(record, name):
                setattr(record, name, known.get(name, ""))
        return True


class TextFormatter(logging.Formatter):
    """Formats each record as ROS 2 prints it, so that nobody forges a line or steers a terminal.

    What callers have sent may stand in it. Control characters are written as `\\x1b`, and so are
    ends of lines that the program's own text has not; what follows a first line is indented.
    """

    def __init__(self) -> None:
        super().__init__()

    def format(self, record: logging.LogRecord) -> str:
        """The line, with a traceback below it where there is one."""
        text = record.getMessage()
        if not text.isprintable():
            parts = text.split("\n") if "\n" in str(record.msg) else [text]
            text = "\n  ".join(map(_harmless, parts))
        lines = [f"[{record.levelname}] [{record.created:.9f}] [{record.name}]: {text}"]
        if record.exc_info:
            lines += self.formatException(record.exc_info).splitlines()
        if record.stack_info:
            lines += self.formatStack(record.stack_info).splitlines()
        return "\n  ".join([lines[0], *map(_harmless, lines[1:])])


class JsonFormatter(logging.Formatter):
    """Formats each record as one line of JSON.

    Keys: `time` (UTC), `level`, `logger`, `message`; then what the line carries besides, such as
    `call`, `service`, `caller`, `task` or an `extra` of your own; `error` with the whole traceback
    where there is one.
    """

    def __init__(self) -> None:
        super().__init__()
        usual = vars(logging.LogRecord("", 0, "", 0, "", (), None))
        self._usual = {*usual, "message", "asctime", "taskName"}

    def format(self, record: logging.LogRecord) -> str:
        """The line, without its end."""
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
    """A handler for `logging.basicConfig(handlers=[...])`: stderr unless `stream` says otherwise.

    `style` is `text`, as ROS 2 prints it, or `json`; a `CallFilter` is in it.

    Raises ValueError for another style.
    """
    if style not in STYLES:
        raise ValueError(f"style: expected 'text' or 'json', got {style!r}")
    made = logging.StreamHandler(stream)
    made.setFormatter(JsonFormatter() if style == "json" else TextFormatter())
    made.addFilter(CallFilter())
    return made


def _harmless(text: str) -> str:
    return _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def _utc(created: float) -> str:
    from datetime import UTC, datetime  # servers that log text start without it

    moment = datetime.fromtimestamp(created, UTC)
    return moment.isoformat(timespec="microseconds").replace("+00:00", "Z")


def _encoded(value: Any) -> str:
    import json

    # Whatever somebody logs, a line comes out: NaN, rings of lists and odd keys become text.
    try:
        return json.dumps(value, default=repr, allow_nan=False)
    except (ValueError, TypeError, RecursionError):
        return json.dumps(repr(value))
