"""A damaged record is reported with its table, its row and what is wrong, and never believed."""

import msgspec
import pytest

from taskrpc.core.storage.records import Damaged, read_records, with_checksum


class Seat(msgspec.Struct):
    number: int


def row(number, client=b"ann", record=None):
    """A row as SQLite gives it: the key, the record, the checksum."""
    record = b'{"number":%d}' % number if record is None else record
    checksum, text = with_checksum(record, number, client.decode(errors="replace"))
    return number, client, text.encode(), checksum


def read(*rows):
    return read_records(rows, Seat, "seat", "number", "client")


def damage(*rows):
    with pytest.raises(Damaged) as caught:
        read(*rows)
    error = caught.value
    assert str(error) == f"table seat: {error.problem}"
    assert error.table == "seat"
    return error.problem, error.where


def test_intact_records_are_read_in_order():
    assert read(row(2), row(1, b"bob")) == [Seat(2), Seat(1)]
    assert read() == []


def test_record_without_text_is_reported():
    number, client, _, checksum = row(7)
    problem, where = damage(row(1), (number, client, 5, checksum))
    assert problem == "expected a text, found int"
    assert where == "number = 7 AND client = 'ann'"


def test_record_with_another_checksum_is_reported():
    number, client, text, checksum = row(7)
    problem, where = damage((number, client, text, checksum + 1))
    assert (problem, where) == ("the checksum does not match", "number = 7 AND client = 'ann'")
    other_key = (8, client, text, checksum)
    assert damage(other_key)[1] == "number = 8 AND client = 'ann'"


@pytest.mark.parametrize(
    ("record", "problem"),
    [(b'{"number":"x"}', "Expected `int`, got `str`"), (b"{", "Input data was truncated")],
)
def test_record_of_another_kind_is_reported_with_its_own_row(record, problem):
    found, where = damage(row(1), row(7, record=record), row(9))
    assert problem in found
    assert where == "number = 7 AND client = 'ann'"


def test_row_whose_key_is_damaged_too_is_not_shown_as_sql():
    number, _, text, checksum = row(7)
    for client in (b"'; DROP TABLE seat", b""):
        assert damage((number, client, text, checksum))[1] == ""
