"""CDR has the same bytes as other implementations, and is decoded to the same message."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from srvgen import define, from_builtins, from_cdr, to_cdr
from srvgen.definitions.derived import references
from srvgen.definitions.lines import join_full_text
from srvgen.files.reading import decode, parse_definition

CORPUS = Path(__file__).parents[4] / "shared" / "corpus"
pytestmark = pytest.mark.skipif(not CORPUS.is_dir(), reason="the corpus is not beside the checkout")


def rows(oracle: str) -> list[dict[str, Any]]:
    with (CORPUS / "oracles" / f"{oracle}.jsonl").open(encoding="utf-8") as lines:
        return [json.loads(line) for line in lines]


@cache
def homes() -> dict[tuple[str, str], dict[str, Any]]:
    """The file that defines a type of a certain hash."""
    return {item: row for row in rows("rihs01") for item in row["hashes"].items()}


@cache
def files() -> dict[str, dict[str, dict[str, Any]]]:
    """Every file that defines a name, by its repository."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for row in rows("rihs01"):
        name = f"{row['package']}/{row['kind']}/{row['name']}"
        found.setdefault(name, {})[owner_of(row)] = row
    return found


def owner_of(row: dict[str, Any]) -> str:
    return row["path"].partition("/")[0]


def text_of(row: dict[str, Any]) -> str:
    return decode((CORPUS / row["path"]).read_bytes(), row["path"])


def needed_by(row: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The files of the nested types, from the same repository where it has them."""
    text = text_of(row)
    definition = parse_definition(text, row["package"], row["kind"], row["name"], path=row["path"])
    for field in references(definition):
        by_owner = files()[field.type.full_name]
        ros2 = [one for repo, one in sorted(by_owner.items()) if repo.startswith("ros2__")]
        yield by_owner.get(owner_of(row)) or (ros2 or list(by_owner.values()))[0]


def texts_needed_by(row: dict[str, Any]) -> dict[str, str]:
    texts: dict[str, str] = {}
    for one in needed_by(row):
        texts[f"{one['package']}/{one['kind']}/{one['name']}"] = text_of(one)
        texts.update(texts_needed_by(one))
    return texts


def classes(cls: Any) -> Iterator[Any]:
    """A class and all classes in its namespace."""
    yield cls
    for one in vars(cls).values():
        if isinstance(one, type) and one.__name__ != "Impl" and hasattr(one, "_TYPE"):
            yield from classes(one)
    if "Impl" in vars(cls):
        for one in ("SendGoalService", "GetResultService", "FeedbackMessage"):
            yield from classes(getattr(cls.Impl, one))


@cache
def class_of(type_name: str, type_hash: str) -> Any:
    row = homes()[type_name, type_hash]
    full_text = join_full_text(text_of(row), texts_needed_by(row))
    main = define(f"{row['package']}/{row['kind']}/{row['name']}", full_text)
    (cls,) = (one for one in classes(main) if type_name == one._TYPE)
    assert type_hash == cls._HASH
    return cls


def plain(value: Any) -> Any:
    """A value with the oracle's spelling of numbers that JSON does not have."""
    if isinstance(value, list):
        return [plain(item) for item in value]
    if not isinstance(value, dict):
        return value
    if "$float" in value:
        return float(value["$float"])
    return {name: plain(item) for name, item in value.items()}


@pytest.mark.corpus
@pytest.mark.parametrize(("oracle", "least"), [("cdr", 855), ("cdr_wstring_derived", 18)])
def test_bytes_are_those_of_the_oracle_and_are_read_back(oracle, least):
    checked = 0
    for row in rows(oracle):
        cls = class_of(row["type"], row["rihs01"])
        message = from_builtins(cls, plain(row["value"]))
        data = bytes.fromhex(row["hex"])
        assert to_cdr(message).hex() == row["hex"], row["type"]
        again = from_cdr(cls, data)
        assert repr(again) == repr(message)  # by which nan equals nan
        assert to_cdr(again) == data
        checked += 1
    assert checked >= least
