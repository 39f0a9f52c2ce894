"""Compiles the decoder of a message class from its plan, and one for sequences of messages.

The generated source for geometry_msgs/PoseStamped is as follows. R are formats of `struct`, P are
fixed parts, which know the paths of their values, and C are classes:

    def decode(data):
        try:
            header, v4, v5, n6 = R1(data, 0)
        except READ_ERRORS:
            raise P2.error(data, 0) from None
        if header != 0x100:
            raise foreign_header(data)
        at = 16 + n6 - 1
        try:
            v6 = data[16:at].decode()
        except UnicodeDecodeError as error:
            raise not_text('header.frame_id', error, at, data) from None
        ...
        return C3(header=C4(stamp=C5(sec=v4, nanosec=v5), frame_id=v6), pose=...)

Before anything is allocated, the data must be long enough for it.
"""

from __future__ import annotations

import struct
import sys
from array import array as array_type
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

from .codegen import Names, Position, compiled, indented
from .errors import (
    CdrError,
    foreign_header,
    inside,
    left_over,
    not_boolean,
    not_text,
    not_that_many,
    too_long,
    too_many,
    without_nul,
)
from .layout import FixedPart, Item
from .plan import KEPT_CLASSES, Node, Plan, Value, VariablePart, plan_of
from .values import booleans, from_wide, read_strings, read_wstrings, single_bytes

# On 32-bit Python a wrong length can give an offset that is too large for `struct`.
_READ_ERRORS = (struct.error, OverflowError)
_HELPERS = (
    CdrError,
    booleans,
    foreign_header,
    from_wide,
    inside,
    left_over,
    not_boolean,
    not_text,
    not_that_many,
    single_bytes,
    too_long,
    too_many,
    without_nul,
)
"""Functions that generated code calls by name."""

_Sequence = tuple[list[Any], int]


def decoder_of(cls: Any) -> Callable[[bytes], Any]:
    """Compile a function that decodes a message with its header, or raises CdrError."""
    reader = _Reader(plan_of(cls, is_element=False), is_element=False)
    result = reader.read_message()
    end = reader.position.current()
    body = [
        *reader.opening,
        *reader.lines,
        f"if len(data) > {end} + 3:",
        f"    raise left_over({end}, data)",
        f"return {result}",
    ]
    lines = ["def decode(data):", *indented(body)]
    decode: Callable[[bytes], Any] = compiled("decode", lines, reader.names, cls._TYPE)
    return decode


@lru_cache(KEPT_CLASSES)
def sequence_decoder_of(cls: Any) -> Callable[[bytes, int, int, str], _Sequence]:
    """Compile a function that decodes messages at a position; it returns them and their end."""
    plan = plan_of(cls, is_element=True)
    reader = _Reader(plan, is_element=True)
    result = reader.read_message()
    reader.position.assign()
    lines = [
        "def decode(data, at, count, path):",
        f"    if count * {plan.min_size} > len(data) - at:",
        "        raise not_that_many(path, count, at, data)",
        *indented(reader.opening),
        "    found = []",
        "    try:",
        "        for _ in range(count):",
        *indented(indented(indented(reader.lines))),
        f"            found.append({result})",
        "    except CdrError as error:",
        "        raise inside(error, f'{path}[{len(found)}]') from None",
        "    return found, at",
    ]
    decode: Callable[[bytes, int, int, str], _Sequence]
    decode = compiled("decode", lines, reader.names, cls._TYPE)
    return decode


class _Reader:
    """Writes statements for the steps of a plan, and an expression for the message.

    Attributes:
        opening: statements that the function executes once, first.
        lines: the statements so far.
    """

    def __init__(self, plan: Plan, *, is_element: bool) -> None:
        self.plan = plan
        self.opening: list[str] = []
        self.lines: list[str] = []
        self.names = Names(READ_ERRORS=_READ_ERRORS, **{one.__name__: one for one in _HELPERS})
        self.position = Position(self.lines, is_known=not is_element)

    def read_message(self) -> str:
        """Write the statements; returns the expression of the message."""
        for step in self.plan.steps:
            if isinstance(step, FixedPart):
                self._fixed_part(step)
            else:
                self._variable_part(step)
        return self._made(self.plan.root)

    def _made(self, node: Node) -> str:
        values = [
            f"{attribute}={self._made(one) if isinstance(one, Node) else self._converted(one)}"
            for attribute, one in node.fields.items()
        ]
        return f"{self.names.of(node.cls, 'C')}({', '.join(values)})"

    def _converted(self, value: Value) -> str:
        """The expression that converts the content of a field to its value."""
        content = value.content
        match value.kind:
            case "bool" if value.is_array:
                return f"booleans({content}, {value.path!r})"
            case "bool":
                return f"{content} == 1"
            case "byte" if value.is_array:
                return f"single_bytes({content})"
            case "number" if value.is_array:
                return self._array(value)
            case _:
                return content

    def _array(self, value: Value) -> str:
        array = f"a{value.number}"
        # Filled from a memoryview: the constructor needs bytes, which would be a second copy.
        make = partial(array_type.__new__, value.cls, value.cls._CODE)
        self.lines.append(f"{array} = {self.names.of(make, 'A')}()")
        self.lines.append(f"{array}.frombytes({value.content})")
        if sys.byteorder == "big":
            self.lines.append(f"{array}.byteswap()")
        return array

    def _fixed_part(self, part: FixedPart) -> None:
        at = self.position.current()
        if part.has_one_layout:
            read = f"{self.names.of(part.layout.unpack_from, 'R')}(data, {at})"
            self.position.add(part.layout.size)
        else:
            table = self.names.of(part.layouts, "R")
            layout = table.lower()
            self.lines.append(f"{layout} = {table}[{at} & 7]")
            read = f"{layout}.unpack_from(data, {at})"
            self.position.add(f"{layout}.size")
        variables = "".join(f"{item.variable}, " for item in part.items if item.variable)
        statement = f"{variables[:-1]} = {read}" if variables else read
        self._guard(statement, "READ_ERRORS", f"{self.names.of(part, 'P')}.error(data, {at})")
        for item in part.items:
            self._check(item)

    def _check(self, item: Item) -> None:
        match item.role:
            case "header":
                self._refuse(f"{item.variable} != {item.argument}", "foreign_header(data)")
            case "nul":
                self._refuse(item.variable, f"without_nul({item.path!r})")
            case "bool":
                self._refuse(f"{item.variable} > 1", f"not_boolean({item.path!r}, {item.variable})")

    def _variable_part(self, part: VariablePart) -> None:
        value = part.value
        if value.most is not None:
            error = f"too_many({value.path!r}, {value.most}, {value.count})"
            self._refuse(f"{value.count} > {value.most}", error)
        if value.kind == "message":
            self._call(sequence_decoder_of(value.cls), value, "")
        elif value.is_array and not value.code:
            read = read_strings if value.kind == "string" else read_wstrings
            self._call(read, value, f", {value.bound}")
        elif value.kind == "string":
            self._string(value)
        else:
            self._elements(value, part.is_aligned)

    def _call(self, function: Callable[..., _Sequence], value: Value, more: str) -> None:
        name, at = self.names.of(function, "F"), self.position.current()
        arguments = f"data, {at}, {value.count}, {value.path!r}{more}"
        self.lines.append(f"{value.content}, at = {name}({arguments})")
        self.position.reset()

    def _string(self, value: Value) -> None:
        start = self._start(value)
        # The NUL belongs to the next part, whose check shows whether the data are long enough. For
        # a string of length 0 without NUL, the last byte of its length, a zero, is used instead.
        self.lines.append(f"at = {start} + {value.count} - 1")
        self.position.reset()
        error = f"not_text({value.path!r}, error, at, data)"
        decoded = f"{value.content} = data[{start}:at].decode()"
        self._guard(decoded, "UnicodeDecodeError as error", error)
        self._check_bound(value)

    def _elements(self, value: Value, is_aligned: bool) -> None:
        if not is_aligned:
            gap = f"(4 - {self.position.current()}) & {value.size - 1}"
            self.position.add(f"({gap} if {value.count} else 0)")
        start = self._start(value)
        size, what = (4, "code units") if value.kind == "wstring" else (value.size, "elements")
        self.lines.append(f"at = {start} + {value.count} * {size}")
        self.position.reset()
        error = f"not_that_many({value.path!r}, {value.count}, {start}, data, {what!r})"
        self._refuse("at > len(data)", error)
        content = f"data[{start}:at]"
        if value.kind == "number":
            content = f"view[{start}:at]"
            self.opening = ["view = memoryview(data)"]
        elif value.kind == "wstring":
            content = f"from_wide({content}, {value.path!r})"
        self.lines.append(f"{value.content} = {content}")
        self._check_bound(value)

    def _start(self, value: Value) -> str:
        """The start of a variable part; `at` is assigned its end afterwards."""
        start = self.position.current()
        if start == "at":
            start = f"s{value.number}"
            self.lines.append(f"{start} = at")
        return start

    def _check_bound(self, value: Value) -> None:
        if value.bound is not None:
            error = f"too_long({value.path!r}, {value.bound}, {value.content})"
            self._refuse(f"len({value.content}) > {value.bound}", error)

    def _refuse(self, condition: str, error: str) -> None:
        self.lines += [f"if {condition}:", f"    raise {error}"]

    def _guard(self, statement: str, errors: str, error: str) -> None:
        self.lines += [
            "try:",
            f"    {statement}",
            f"except {errors}:",
            f"    raise {error} from None",
        ]
