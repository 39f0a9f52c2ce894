"""The keys of turtle_teleop_key: what each does, and how terminals send them. Pure."""

from __future__ import annotations

from dataclasses import dataclass

UP, DOWN, LEFT, RIGHT, QUIT, CANCEL = "up", "down", "left", "right", "q", "f"

DIRECTIONS: dict[str, tuple[float, float]] = {
    UP: (1.0, 0.0),
    DOWN: (-1.0, 0.0),
    LEFT: (0.0, 1.0),
    RIGHT: (0.0, -1.0),
}
"""The linear and angular velocity of each arrow key, before they are scaled."""

HEADINGS = {
    "g": 0.0,
    "t": 0.7854,
    "r": 1.5708,
    "e": 2.3562,
    "d": 3.1416,
    "c": -2.3562,
    "v": -1.5708,
    "b": -0.7854,
}
"""The heading of each key around F: the direction from F to the key on a keyboard [rad]."""

_ARROWS = {b"A": UP, b"B": DOWN, b"C": RIGHT, b"D": LEFT}
_WINDOWS_ARROWS = {"H": UP, "P": DOWN, "M": RIGHT, "K": LEFT}
_ESCAPE = b"\x1b"
_INTRODUCERS = (b"[", b"O")


def windows_arrow(code: str) -> str:
    """Return the arrow key of the second code that Windows reports for a special key, or ""."""
    return _WINDOWS_ARROWS.get(code, "")


@dataclass
class KeyDecoder:
    """Turns the bytes of a terminal into keys; an arrow key sends three bytes."""

    _pending: bytes = b""

    def feed(self, byte: bytes) -> str:
        """Take one byte; return the key that it completes, or "" if it completes none."""
        before, self._pending = self._pending, b""
        if byte == _ESCAPE:
            self._pending = byte
        elif before == _ESCAPE and byte in _INTRODUCERS:
            self._pending = before + byte
        elif len(before) == 2:
            return _ARROWS.get(byte, "")
        else:
            return byte.decode("ascii", "replace").lower()
        return ""
