"""Encodes and decodes strings, booleans and bytes; compiled encoders and decoders call it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from typing import Any

from .errors import (
    CdrError,
    ended,
    inside,
    not_boolean,
    not_text,
    not_that_many,
    too_long,
    without_nul,
)

_LENGTH = struct.Struct("<I")


def booleans(raw: bytes, path: str) -> list[bool]:
    """Decode booleans. Raises CdrError with the index of an invalid byte."""
    for byte in raw.strip(b"\0\1"):
        if byte > 1:
            at = next(i for i, one in enumerate(raw) if one > 1)
            raise not_boolean(f"{path}[{at}]", raw[at])
    return list(map(bool, raw))


def single_bytes(raw: bytes) -> list[bytes]:
    """Each byte as `bytes` of length 1."""
    return list(struct.unpack(f"{len(raw)}c", raw))


def wide(text: str) -> bytes:
    """Encode a wstring: UTF-16 code units, each in four bytes."""
    raw = text.encode("utf-16-le")
    count = len(raw) // 2
    return struct.pack(f"<{count}I", *struct.unpack(f"<{count}H", raw))


def from_wide(raw: bytes, path: str) -> str:
    """Decode UTF-16 code units, each in four bytes. Raises CdrError."""
    count = len(raw) // 4
    units = struct.unpack(f"<{count}I", raw)
    try:
        return struct.pack(f"<{count}H", *units).decode("utf-16-le")
    except struct.error:
        problem = f"expected UTF-16 code units, got 0x{max(units):x}"
    except UnicodeDecodeError as error:
        problem = f"expected UTF-16, got a lone surrogate as code unit {error.start // 2}"
    raise CdrError(path, problem)


def add_strings(parts: list[Any], texts: Iterable[str], at: int) -> int:
    """Append the strings of a sequence at the position `at`; returns its end."""
    for text in texts:
        gap = -at & 3
        raw = text.encode()
        parts += (bytes(gap), _LENGTH.pack(len(raw) + 1), raw, b"\0")
        at += gap + 5 + len(raw)
    return at


def add_wstrings(parts: list[Any], texts: Iterable[str], at: int) -> int:
    """Append the wstrings of a sequence at the position `at`; returns its end."""
    for text in texts:
        gap = -at & 3
        raw = wide(text)
        parts += (bytes(gap), _LENGTH.pack(len(raw) // 4), raw)
        at += gap + 4 + len(raw)
    return at


def read_strings(
    data: bytes, at: int, count: int, path: str, bound: int | None
) -> tuple[list[str], int]:
    """Decode the strings of a sequence at `at`; returns them and the end. Raises CdrError."""
    return _texts(_string, data, at, count, path, bound)


def read_wstrings(
    data: bytes, at: int, count: int, path: str, bound: int | None
) -> tuple[list[str], int]:
    """Decode the wstrings of a sequence at `at`; returns them and the end. Raises CdrError."""
    return _texts(_wstring, data, at, count, path, bound)


_Read = Callable[[bytes, int], tuple[str, int]]


def _texts(
    read: _Read, data: bytes, at: int, count: int, path: str, bound: int | None
) -> tuple[list[str], int]:
    if count * _LENGTH.size > len(data) - at:
        raise not_that_many(path, count, at, data)
    texts: list[str] = []
    try:
        for _ in range(count):
            text, at = read(data, at)
            if bound is not None and len(text) > bound:
                raise too_long("", bound, text)
            texts.append(text)
    except CdrError as error:
        raise inside(error, f"{path}[{len(texts)}]") from None
    return texts, at


def _string(data: bytes, at: int) -> tuple[str, int]:
    start, length = _length(data, at)
    end = start + length
    if end > len(data):
        raise ended("", "the NUL of a string", end - 1, data)
    # For a string of length 0 without NUL, this byte is the last of the length, which is zero.
    if data[end - 1]:
        raise without_nul("")
    try:
        return data[start : end - 1].decode(), end
    except UnicodeDecodeError as error:
        raise not_text("", error, end, data) from None


def _wstring(data: bytes, at: int) -> tuple[str, int]:
    start, count = _length(data, at)
    end = start + 4 * count
    if end > len(data):
        raise not_that_many("", count, start, data, "code units")
    return from_wide(data[start:end], ""), end


def _length(data: bytes, at: int) -> tuple[int, int]:
    at += -at & 3
    if at + _LENGTH.size > len(data):
        raise ended("", "the length of a string", at, data)
    return at + _LENGTH.size, _LENGTH.unpack_from(data, at)[0]
