"""A database is only used with the tables that taskrpc writes."""

import re
import sqlite3

import pytest

from taskrpc.core.storage.table_checks import refuse_other_tables
from taskrpc.errors import StoreError


def create(connection):
    connection.execute("CREATE TABLE seat (number INTEGER PRIMARY KEY, owner TEXT NOT NULL)")


@pytest.fixture
def connection():
    connection = sqlite3.connect(":memory:")
    yield connection
    connection.close()


@pytest.mark.parametrize("text_factory", [str, bytes])
def test_database_with_the_same_and_further_tables_is_accepted(connection, text_factory):
    connection.text_factory = text_factory
    create(connection)
    connection.execute("CREATE TABLE other (x)")
    refuse_other_tables(connection, create)


@pytest.mark.parametrize(
    ("table", "found"),
    [
        ("", "it is missing"),
        ("CREATE TABLE seat (number INTEGER PRIMARY KEY)", "found (number INTEGER key 1)"),
        (
            "CREATE TABLE seat (number INTEGER, owner TEXT NOT NULL DEFAULT 'ann')",
            "found (number INTEGER, owner TEXT NOT NULL 'ann')",
        ),
    ],
)
def test_database_with_other_columns_is_refused(connection, table, found):
    connection.execute(table)
    expected = "expected (number INTEGER key 1, owner TEXT NOT NULL), " + found
    with pytest.raises(StoreError, match=re.escape(expected) + "; restore a copy"):
        refuse_other_tables(connection, create)
