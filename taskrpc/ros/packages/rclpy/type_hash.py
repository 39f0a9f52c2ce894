"""Type hashes, which identify the definition of a type."""

from __future__ import annotations

from typing import TypedDict


class TypeHashDictionary(TypedDict):
    """A type hash as keyword arguments."""

    version: int
    value: bytes


class TypeHash:
    """A version and 32 bytes, written `RIHS01_` and 64 hexadecimal digits."""

    _TYPE_HASH_SIZE = 32

    __slots__ = ["_value", "_version"]

    def __init__(self, version: int = -1, value: bytes = bytes(_TYPE_HASH_SIZE)) -> None:
        self.version = version
        self.value = value

    @property
    def version(self) -> int:
        """The version of the algorithm; -1 for no hash."""
        return self._version

    @version.setter
    def version(self, value: int) -> None:
        assert isinstance(value, int)
        self._version = value

    @property
    def value(self) -> bytes:
        """The 32 bytes."""
        return self._value

    @value.setter
    def value(self, value: bytes) -> None:
        assert isinstance(value, bytes)
        self._value = value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TypeHash):
            return False
        return (self._version, self._value) == (other._version, other._value)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        if self._version <= 0 or len(self._value) != self._TYPE_HASH_SIZE:
            return "INVALID"
        return f"RIHS{self._version:02}_{self._value.hex()}"


def type_hash_of(text: str) -> TypeHash:
    """Read a hash such as `RIHS01_…`."""
    version, _, digits = text.removeprefix("RIHS").partition("_")
    return TypeHash(int(version), bytes.fromhex(digits))
