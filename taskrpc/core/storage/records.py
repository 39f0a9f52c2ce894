"""Records in a table, each with a checksum: a damaged record is reported and never used."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import msgspec

_Record = TypeVar("_Record")


class Damaged(Exception):
    """A table does not contain the data that was written to it.

    Attributes:
        table: its name.
        problem: what is wrong.
        where: the row as an SQL condition; "" if the row has no usable key.
    """

    def __init__(self, table: str, problem: str, where: str = "") -> None:
        self.table, self.problem, self.where = table, problem, where
        super().__init__(f"table {table}: {problem}")


def with_checksum(record: bytes, *key: int | str) -> tuple[int, str]:
    """Return the checksum of a record and its key, and the record's text."""
    return zlib.crc32(record, _key_sum(map(str, key))), record.decode()


def read_records(
    rows: Sequence[tuple[Any, ...]], kind: type[_Record], table: str, *columns: str
) -> list[_Record]:
    """Return the records of rows with the columns: the key's, record, checksum. Raises Damaged."""
    records = [_intact(row, table, columns) for row in rows]
    try:
        return _decode_all(records, kind)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        for row, record in zip(rows, records, strict=True):
            try:
                msgspec.json.decode(record, type=kind)
            except (msgspec.MsgspecError, UnicodeDecodeError) as error:
                raise Damaged(table, str(error), _where(row, columns)) from None
        raise


def _decode_all(records: list[bytes], kind: type[_Record]) -> list[_Record]:
    text = b"[" + b",".join(records) + b"]"
    return msgspec.json.decode(text, type=list[kind])  # type: ignore[valid-type]


def _intact(row: tuple[Any, ...], table: str, columns: tuple[str, ...]) -> bytes:
    *key, record, checksum = row
    if not isinstance(record, bytes):
        problem = f"expected a text, found {type(record).__name__}"
        raise Damaged(table, problem, _where(row, columns))
    if zlib.crc32(record, _key_sum(map(_text, key))) != checksum:
        raise Damaged(table, "the checksum does not match", _where(row, columns))
    return record


def _key_sum(key: Iterable[str]) -> int:
    return zlib.crc32(" ".join(key).encode())


def _where(row: tuple[Any, ...], columns: tuple[str, ...]) -> str:
    """Return the row as an SQL condition that a user can copy, "" if the key is damaged too."""
    key = row[: len(columns)]
    if not all(isinstance(each, int) or _text(each).isalnum() for each in key):
        return ""
    values = (f"{each}" if isinstance(each, int) else f"'{_text(each)}'" for each in key)
    return " AND ".join(f"{name} = {value}" for name, value in zip(columns, values, strict=True))


def _text(key: Any) -> str:
    return key.decode(errors="replace") if isinstance(key, bytes) else str(key)
