"""Explains wrong uses of message classes and of taskrpc's functions, from the error's traceback.

Python and msgspec raise these errors without naming the class or its fields, and a check in our
constructors would slow down all calls. So the class is found afterwards: the traceback has the
expression that failed, and the frame has the values of its names.
"""

from __future__ import annotations

import ast
import inspect
import linecache
import os
import re
from itertools import islice
from types import CoroutineType, FrameType, TracebackType
from typing import Any

from .convert import unknown_field

_POSITIONAL = "Extra positional arguments provided"
_FIELD = re.compile(r"Unexpected keyword argument '(\w+)'")
_ATTRIBUTE = re.compile(r"'(\w+)' object has no attribute '(\w+)'")
_ARGUMENT = re.compile(
    r"(?:.*\.)?\w+\(\) got an unexpected keyword argument '(\w+)'(\. Did you mean .*)?"
)
_AWAIT = re.compile(r"(object \w+|'[\w.]+' object) can't be (used in 'await' expression|awaited)")

_OURS = ("srvgen", "taskrpc")
_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_FOLDERS = tuple(os.path.join(_ROOT, package, "") for package in _OURS)
_NAMES_OF_ROS = {
    "node_name": "name",
    "qos_profile": "qos",
    "timeout_sec": "timeout",
    "timer_period_sec": "period",
}
"""Arguments of rclpy, with their names in taskrpc's own nodes."""
_NO_GROUPS = "there are no callback groups here: concurrency= is the number of calls at a time"


def explanation(error: BaseException) -> str:
    """Return the text that explains an error to the program's author, "" if none is known."""
    if isinstance(error, TypeError):
        return _of_type_error(error, str(error))
    if isinstance(error, AttributeError) and (found := _ATTRIBUTE.fullmatch(str(error))):
        return _of_attribute(error, found[2])
    return ""


def _of_type_error(error: TypeError, text: str) -> str:
    if text == _POSITIONAL:
        return _by_name(error)
    if found := _FIELD.fullmatch(text):
        return _of_field(_called(error), found[1])
    if found := _ARGUMENT.fullmatch(text):
        return _of_argument(_called(error), found[1])
    return _of_await(error) if _AWAIT.fullmatch(text) else ""


def _by_name(error: TypeError) -> str:
    """The explanation for fields without names."""
    cls = _called(error)
    _, expression = _failed(error.__traceback__)
    if not _has_fields(cls) or not isinstance(expression, ast.Call):
        return ""
    fields = ", ".join(f"{name}=..." for name, _ in cls._FIELDS)
    written = ast.unparse(expression.func)
    return f"{cls.__name__} takes its fields by name: write {written}({fields})"


def _of_field(cls: Any, name: str) -> str:
    return unknown_field(cls, name) if _has_fields(cls) else ""


def _of_attribute(error: AttributeError, name: str) -> str:
    """The explanation for a field that a message does not have, or for a forgotten `await`."""
    value: Any = error.obj
    if value is None:  # Python 3.11 does not keep the object of an assignment
        frame, expression = _failed(error.__traceback__)
        if frame is not None and isinstance(expression, ast.Attribute):
            value = _value(expression.value, frame)
    cls: Any = type(value)
    if _has_fields(cls):
        return unknown_field(cls, name)
    if isinstance(value, CoroutineType) and value.cr_code.co_filename.startswith(_FOLDERS):
        return (
            f"{value.__qualname__}() has not run, because nothing awaits it: write `await` before"
            " the call"
        )
    return ""


def _of_argument(function: Any, name: str) -> str:
    """The explanation for an argument that a function of taskrpc does not have."""
    target = (
        inspect.getattr_static(function, "__init__") if isinstance(function, type) else function
    )
    if not str(getattr(target, "__module__", "")).startswith(_OURS):
        return ""
    known = [each for each in inspect.signature(target).parameters if each != "self"]
    meant = _NAMES_OF_ROS.get(name)
    if meant in known:
        hint = f"; write {meant}=, which is rclpy's {name}"
    elif name == "callback_group":
        hint = f"; {_NO_GROUPS}" if "concurrency" in known else ""
    else:
        from .definitions.names import did_you_mean  # few programs need it

        guess = did_you_mean(name, known)
        hint = f"; {guess}" if guess else ""
    shown = function.__name__ if isinstance(function, type) else target.__qualname__
    return f"{shown}() has no argument {name!r}{hint}"


def _of_await(error: TypeError) -> str:
    """The explanation for `await` before a call of the blocking API."""
    frame, expression = _failed(error.__traceback__)
    if frame is None or not isinstance(expression, ast.Await):
        return ""
    call = expression.value
    function = _value(call.func, frame) if isinstance(call, ast.Call) else None
    if function is None or not str(getattr(function, "__module__", "")).startswith("taskrpc.sync"):
        return ""
    return (
        f"{function.__name__}() of taskrpc.sync returns its result itself: write it without"
        " `await`, or use taskrpc.Node in async code"
    )


def _has_fields(cls: Any) -> bool:
    return isinstance(cls, type) and bool(getattr(cls, "_TYPE", "")) and hasattr(cls, "_FIELDS")


def _is_ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__")).startswith(_OURS)


def _called(error: BaseException) -> Any:
    """The class or function whose call failed, None if it cannot be found."""
    frame, expression = _failed(error.__traceback__)
    if frame is None or not isinstance(expression, ast.Call):
        return None
    return _value(expression.func, frame)


def _failed(traceback: TracebackType | None) -> tuple[FrameType | None, ast.expr | None]:
    """Return the program's frame in which an error was raised, and the expression that failed."""
    last = None
    while traceback is not None:
        if not _is_ours(traceback.tb_frame):
            last = traceback
        traceback = traceback.tb_next
    if last is None:
        return None, None
    code = last.tb_frame.f_code
    position = next(islice(code.co_positions(), last.tb_lasti // 2, None), (None,) * 4)
    line, end_line, column, end_column = position
    if line is None or end_line is None or column is None or end_column is None:
        return None, None
    lines = linecache.getlines(code.co_filename, last.tb_frame.f_globals)[line - 1 : end_line]
    if not lines:
        return None, None
    # Columns count bytes of UTF-8. Cut the end first: it may be in the first line too.
    encoded = [each.encode() for each in lines]
    encoded[-1] = encoded[-1][:end_column]
    encoded[0] = encoded[0][column:]
    try:
        return last.tb_frame, ast.parse(b"(" + b"".join(encoded) + b")", mode="eval").body
    except SyntaxError:
        return None, None


def _value(expression: ast.expr, frame: FrameType) -> Any:
    """The value of a name with attributes, such as `self.client.call`; None for all else."""
    if isinstance(expression, ast.Name):
        for names in (frame.f_locals, frame.f_globals, frame.f_builtins):
            if expression.id in names:
                return names[expression.id]
    if isinstance(expression, ast.Attribute):
        try:
            return getattr(_value(expression.value, frame), expression.attr)
        except Exception:  # a property of the program may raise anything
            return None
    return None
