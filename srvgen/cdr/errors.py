"""The errors of CDR data, each with the path of the field."""

from __future__ import annotations

from .._runtime import FieldError, with_prefix

REPRESENTATIONS = {
    0x0000: "big-endian XCDR1",
    0x0002: "a big-endian parameter list",
    0x0003: "a parameter list",
    0x0006: "big-endian XCDR2",
    0x0007: "XCDR2",
    0x0008: "big-endian delimited XCDR2",
    0x0009: "delimited XCDR2",
    0x000A: "a big-endian XCDR2 parameter list",
    0x000B: "an XCDR2 parameter list",
}
"""Encodings that the first two bytes may announce instead of little-endian XCDR1."""


class CdrError(FieldError):
    """Bytes are not a message of the class that they were decoded as.

    Attributes:
        path: the invalid field: `poses[3].header.frame_id`; empty for the whole message.
        problem: what was expected and what was received.
    """


def inside(error: CdrError, name: str) -> CdrError:
    """The same error with the field `name` put in front of its path."""
    seen = with_prefix(error, name)
    return CdrError(seen.path, seen.problem)


def ended(path: str, what: str, at: int, data: bytes) -> CdrError:
    """The data end before or inside the value at `at`."""
    return CdrError(path, f"expected {what} at byte {at}, got the end at byte {len(data)}")


def foreign_header(data: bytes) -> CdrError:
    """The header announces another encoding."""
    announced = REPRESENTATIONS.get(int.from_bytes(data[:2], "big"), "an unknown representation")
    return CdrError("", f"expected the header 00 01 of XCDR1, got {data[:2].hex(' ')}, {announced}")


def left_over(at: int, data: bytes) -> CdrError:
    """More bytes follow than padding needs."""
    return CdrError("", f"expected the message to end at byte {at}, got {len(data)} bytes")


def too_many(path: str, most: int, count: int) -> CdrError:
    """A bounded sequence announces more elements than its bound."""
    return CdrError(path, f"expected at most {most} elements, got {count}")


def not_that_many(path: str, count: int, at: int, data: bytes, what: str = "elements") -> CdrError:
    """A sequence announces more elements than the remaining bytes can hold."""
    left = max(len(data) - at, 0)
    return CdrError(path, f"expected {count} {what}, got {left} bytes, which cannot hold them")


def too_long(path: str, bound: int, text: str) -> CdrError:
    """A bounded string is longer than its bound."""
    return CdrError(path, f"expected at most {bound} characters, got {len(text)}")


def without_nul(path: str) -> CdrError:
    """The last byte of a string is not NUL."""
    return CdrError(path, "expected a string that ends in NUL, got another byte there")


def not_text(path: str, error: UnicodeDecodeError, end: int, data: bytes) -> CdrError:
    """The bytes of a string are not UTF-8, or exceed the data."""
    if end > len(data):
        return ended(path, "the NUL of a string", end, data)
    byte = error.object[error.start]
    return CdrError(path, f"expected UTF-8, got 0x{byte:02x} as byte {error.start} of the string")


def not_boolean(path: str, byte: int) -> CdrError:
    """The byte of a bool is neither 0 nor 1."""
    return CdrError(path, f"expected a bool as 0 or 1, got {byte}")
