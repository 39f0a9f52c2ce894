"""Compiles the encoder of a message class from its plan, and one for sequences of messages.

The generated source for geometry_msgs/PoseStamped is as follows. R are formats of `struct`:

    def encode(message):
        m2 = message.header
        m3 = m2.stamp
        ...
        v6 = m2.frame_id.encode()
        n6 = len(v6) + 1
        at = 15 + n6
        return join((R1(0x100, m3.sec, m3.nanosec, n6), v6, R2[at & 7].pack(0, m8.x, ...)))
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from .codegen import Names, Position, compiled, indented
from .layout import FixedPart
from .plan import KEPT_CLASSES, Node, Plan, Value, VariablePart, plan_of
from .values import add_strings, add_wstrings, wide

_ARRAY = "{}" if sys.byteorder == "little" else "{}.little_endian()"
_CONTENTS = {
    "number": _ARRAY,
    "bool": "bytes({})",
    "byte": "join({})",
    "string": "{}.encode()",
    "wstring": "wide({})",
}
_LENGTHS = {"string": "len({}) + 1", "wstring": "len({}) // 4"}


def encoder_of(cls: Any) -> Callable[[Any], bytes]:
    """Compile a function that encodes a checked message with its header."""
    writer = _Writer(plan_of(cls, is_element=False), is_element=False)
    writer.write_message()
    chunks = ", ".join(writer.chunks)
    whole = f"join(({chunks}))" if len(writer.chunks) > 1 else chunks
    if writer.is_long:
        writer.flush()
        writer.lines.insert(0, "parts = []")
        whole = "join(parts)"
    lines = ["def encode(message):", *indented([*writer.lines, f"return {whole}"])]
    encode: Callable[[Any], bytes] = compiled("encode", lines, writer.names, cls._TYPE)
    return encode


@lru_cache(KEPT_CLASSES)
def sequence_encoder_of(cls: Any) -> Callable[[list[bytes], list[Any], int], int]:
    """Compile a function that appends checked messages at a position and returns their end."""
    writer = _Writer(plan_of(cls, is_element=True), is_element=True)
    writer.write_message()
    writer.flush()
    writer.position.assign()
    lines = [
        "def encode(parts, messages, at):",
        "    for message in messages:",
        *indented(indented(writer.lines)),
        "    return at",
    ]
    encode: Callable[[list[bytes], list[Any], int], int]
    encode = compiled("encode", lines, writer.names, cls._TYPE)
    return encode


class _Writer:
    """Writes statements and expressions for the steps of a plan.

    Attributes:
        lines: the statements so far.
        chunks: expressions of bytes that no statement has added to `parts` yet.
        is_long: whether the generated code has a list `parts`.
    """

    def __init__(self, plan: Plan, *, is_element: bool) -> None:
        self.plan = plan
        self.lines: list[str] = []
        self.chunks: list[str] = []
        self.is_long = is_element
        self.names = Names(join=b"".join, wide=wide)
        self.position = Position(self.lines, is_known=not is_element)

    def write_message(self) -> None:
        self._read(self.plan.root)
        for step in self.plan.steps:
            if isinstance(step, FixedPart):
                self._fixed_part(step)
            else:
                self._variable_part(step)

    def flush(self) -> None:
        """Write a statement that adds the chunks to `parts`."""
        if len(self.chunks) == 1:
            self.lines.append(f"parts.append({self.chunks[0]})")
        elif self.chunks:
            self.lines.append(f"parts += ({', '.join(self.chunks)})")
        self.chunks.clear()
        self.is_long = True

    def _read(self, node: Node) -> None:
        for one in node.fields.values():
            if isinstance(one, Node):
                self.lines.append(f"{one.variable} = {one.source}")
                self._read(one)
            elif one.is_array or not one.has_fixed_size:
                self._read_value(one)

    def _read_value(self, value: Value) -> None:
        is_list = value.is_array and value.kind in ("string", "wstring", "message")
        content = "{}" if is_list else _CONTENTS[value.kind]
        if value.fixed is not None and value.kind == "number":
            content += ".tobytes()"
        self.lines.append(f"{value.content} = {content.format(value.source)}")
        if value.fixed is None:
            length = "len({})" if value.is_array else _LENGTHS[value.kind]
            self.lines.append(f"{value.count} = {length.format(value.content)}")

    def _fixed_part(self, part: FixedPart) -> None:
        arguments = ", ".join(item.argument for item in part.items if item.argument)
        if part.has_one_layout:
            self.chunks.append(f"{self.names.of(part.layout.pack, 'R')}({arguments})")
            self.position.add(part.layout.size)
            return
        table = self.names.of(part.layouts, "R")
        layout = table.lower()
        self.lines.append(f"{layout} = {table}[{self.position.current()} & 7]")
        self.chunks.append(f"{layout}.pack({arguments})")
        self.position.add(f"{layout}.size")

    def _variable_part(self, part: VariablePart) -> None:
        value = part.value
        if value.kind == "message":
            self._call(sequence_encoder_of(value.cls), value)
        elif value.is_array and not value.code:
            self._call(add_strings if value.kind == "string" else add_wstrings, value)
        elif value.code:
            self._elements(value, part.is_aligned)
        else:
            self.chunks.append(value.content)
            self.position.add(f"len({value.content})")

    def _call(self, function: Callable[..., int], value: Value) -> None:
        self.flush()
        at = self.position.current()
        self.lines.append(f"at = {self.names.of(function, 'F')}(parts, {value.content}, {at})")
        self.position.reset()

    def _elements(self, value: Value, is_aligned: bool) -> None:
        if not is_aligned:
            gap = f"g{value.number}"
            at = self.position.current()
            self.lines.append(f"{gap} = (4 - {at}) & {value.size - 1} if {value.count} else 0")
            self.chunks.append(f"bytes({gap})")
            self.position.add(gap)
        self.chunks.append(value.content)
        self.position.add(f"{value.count} * {value.size}")
