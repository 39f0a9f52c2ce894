"""Random messages of any class, and a simple XCDR1 encoder that follows the rules literally."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import cache
from random import Random
from typing import Any

from srvgen import load
from srvgen.files.search import BUNDLED

CODES = {
    "bool": "?",
    "byte": "c",
    "char": "B",
    "float32": "f",
    "float64": "d",
    "int8": "b",
    "int16": "h",
    "int32": "i",
    "int64": "q",
    "uint8": "B",
    "uint16": "H",
    "uint32": "I",
    "uint64": "Q",
}
LETTERS = "a Z~\0é\u20ac\U0001f916"


def classes(main: Any) -> Iterator[Any]:
    """The message classes that come with a loaded class: itself, or what its namespace holds."""
    if hasattr(main, "_FIELDS"):
        yield main
    elif hasattr(main, "Impl"):
        yield from (main.Goal, main.Result, main.Feedback, main.Impl.FeedbackMessage)
        yield from classes(main.Impl.SendGoalService)
        yield from classes(main.Impl.GetResultService)
    else:
        yield from (main.Request, main.Response, main.Event)


@cache
def bundled_classes() -> tuple[Any, ...]:
    files = sorted(BUNDLED.glob("*/*/*.*"))
    names = [f"{path.parts[-3]}/{path.parts[-2]}/{path.stem}" for path in files]
    return tuple(cls for name in names for cls in classes(load(name)))


# --- random messages ------------------------------------------------------------------------------


def random_message(cls: Any, random: Random, most: int = 3) -> Any:
    """A message with strings and sequences of up to `most` elements."""
    values = {}
    for (name, text), attribute in zip(cls._FIELDS, cls.__struct_fields__, strict=True):
        base, size = split(text)
        nested = cls._NESTED.get(name)
        items = [
            random_message(nested, random, most) if nested else scalar(base, random, most)
            for _ in range(1 if size is None else count(size, random, most))
        ]
        values[attribute] = items[0] if size is None else items
    return cls(**values)


def split(text: str) -> tuple[str, str | None]:
    base, bracket, size = text.partition("[")
    return base, size.rstrip("]") if bracket else None


def count(size: str, random: Random, most: int) -> int:
    if size.startswith("<="):
        return random.randint(0, min(most, int(size[2:])))
    return int(size) if size else random.randint(0, most)


def scalar(base: str, random: Random, most: int) -> Any:
    if "string" in base:
        bound = int(base.partition("<=")[2] or most)
        return "".join(random.choices(LETTERS, k=random.randint(0, min(bound, most))))
    if base == "bool":
        return random.random() < 0.5
    raw = random.choice((random.randbytes(8), bytes(8), b"\xff" * 7 + b"\x7f", b"\0" * 7 + b"\x80"))
    layout = struct.Struct("<" + CODES[base])
    return layout.unpack(raw[: layout.size])[0]


# --- the rules ------------------------------------------------------------------------------------


def reference_cdr(message: Any) -> bytes:
    """A checked message as XCDR1, slowly."""
    out = bytearray()
    put_message(out, message)
    return b"\x00\x01\x00\x00" + out


def put_message(out: bytearray, message: Any) -> None:
    if not message._FIELDS:
        out.append(0)
    for (_, text), attribute in zip(message._FIELDS, message.__struct_fields__, strict=True):
        base, size = split(text)
        value = getattr(message, attribute)
        if size is None:
            put(out, base, value)
            continue
        if size == "" or size.startswith("<="):
            put_number(out, "I", len(value))
        for item in value:
            put(out, base, item)


def put(out: bytearray, base: str, value: Any) -> None:
    kind = base.partition("<")[0]
    if kind == "string":
        raw = value.encode() + b"\0"
        put_number(out, "I", len(raw))
        out += raw
    elif kind == "wstring":
        raw = value.encode("utf-16-le")
        put_number(out, "I", len(raw) // 2)
        for at in range(0, len(raw), 2):
            put_number(out, "I", int.from_bytes(raw[at : at + 2], "little"))
    elif kind in CODES:
        put_number(out, CODES[kind], value)
    else:
        put_message(out, value)


def put_number(out: bytearray, code: str, value: Any) -> None:
    layout = struct.Struct("<" + code)
    out += bytes(-len(out) % layout.size)
    out += layout.pack(value)
