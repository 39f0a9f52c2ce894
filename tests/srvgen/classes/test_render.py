"""Rendered source: safe against any comment or default, and equal to rosidl's own classes."""

from __future__ import annotations

import ast
import json
import re
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from srvgen.classes.loader import _Builder
from srvgen.classes.render import render
from srvgen.definitions.model import Definition
from srvgen.errors import DefinitionError
from srvgen.files.reading import read_definition
from srvgen.files.search import BUNDLED, Search
from srvgen.parser import parse_msg, parse_srv
from srvgen.typehash import Hasher

CORPUS = Path(__file__).parents[4] / "shared" / "corpus"
ORACLE = CORPUS / "oracles" / "python_classes.jsonl"

bundled = Search([BUNDLED])


def rendered(text: str) -> str:
    return render(parse_msg(text, "demo_msgs", "Demo"), Hasher(bundled.load), "").text


# --- rejected -------------------------------------------------------------------------------------


def test_ros1_types_are_refused_with_the_line():
    with pytest.raises(DefinitionError, match="'time', which ROS 2 does not have") as caught:
        rendered("int32 a\ntime stamp\n")
    assert caught.value.line == 2
    assert "builtin_interfaces/Time" in caught.value.hint


def test_a_missing_nested_type_is_refused():
    with pytest.raises(DefinitionError, match="has no message 'Nowhere'"):
        rendered("geometry_msgs/Nowhere a\n")


def test_non_finite_defaults_are_written_as_names():
    source = rendered("float64 a nan\nfloat64[2] b [inf, -inf]\n")
    assert "a: float = _math.nan" in source
    assert "(_math.inf, -_math.inf)" in source


def test_messages_of_numbers_only_are_left_out_of_garbage_collection():
    assert "gc=False" in rendered("int32 a\nstring b\n")
    assert "gc=False" not in rendered("int32[] a\n")


def test_a_service_keeps_its_definition():
    text = 'int64 a\n---\nstring b  # say "hi"\n'
    source = render(parse_srv(text, "demo_msgs", "Ask"), Hasher(bundled.load), text).text
    assert ast.literal_eval(source.partition("_DEFINITION = ")[2].partition("\n\n\n")[0]) == text


# --- rosidl's own classes -------------------------------------------------------------------------


@cache
def corpus_files() -> dict[str, list[Path]]:
    found = defaultdict(list)
    for kind in ("msg", "srv", "action"):
        for path in sorted(CORPUS.glob(f"*/**/{kind}/*.{kind}")):
            found[f"{path.parent.parent.name}/{kind}/{path.stem}"].append(path)
    return found


class Repository:
    """Definitions of one repository of the corpus, completed by the bundled ones, then others."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.known: dict[str, Definition] = {}

    def load(self, full_name: str) -> Definition:
        if full_name not in self.known:
            self.known[full_name] = self._find(full_name)
        return self.known[full_name]

    def _find(self, full_name: str) -> Definition:
        paths = corpus_files().get(full_name, [])
        own = [path for path in paths if path.relative_to(CORPUS).parts[0] == self.name]
        if own:
            return read_definition(own[0])
        try:
            return bundled.load(full_name)
        except DefinitionError:
            ros2 = [
                one for one in paths if not one.relative_to(CORPUS).parts[0].startswith("ros__")
            ]
            if not ros2:
                raise
            return read_definition(ros2[0])


repository = cache(Repository)


def normal(text: str) -> str:
    """rosidl's repr with numpy's and array's arrays as lists of floats, as ours prints them.

    numpy prints `0.` and line breaks; we have plain arrays, so that spelling must differ.
    """
    text = re.sub(r"\s+", "", text)
    text = re.sub(r"array\((?:'\w',)?(\[[^\]]*\])(?:,dtype=\w+)?\)", r"\1", text)
    return re.sub(
        r"(?<=[\[,=(])-?\d[\d.]*(?:e[+-]?\d+)?(?=[\],)])", lambda one: repr(float(one[0])), text
    )


def differences(row: dict[str, Any], cls: Any) -> list[str]:
    message = cls()
    message._check()
    pairs = {
        "class": (f"{cls.__module__}.{cls.__name__}", row["python"]),
        "types": (list(cls.get_fields_and_field_types().items()),
                  list(row["fields_and_field_types"].items())),
        "constants": ({name: [type(getattr(cls, name)).__name__, repr(getattr(cls, name))]
                       for name in row["constants"]}, row["constants"]),
        "defaults": ({name: normal(repr(_plain(getattr(cls, name))))
                      for name in row["default_attrs"]},
                     {name: normal(value) for name, value in row["default_attrs"].items()}),
        "repr": (normal(repr(cls())), normal(row["default_repr"])),
        "repr after a check": (normal(repr(message)), normal(row["default_repr"])),
        "equal": (cls() == cls(), row["default_eq"]),
    }  # fmt: skip
    return [
        f"{row['type']}: {what}: {ours} != {theirs}"
        for what, (ours, theirs) in pairs.items()
        if ours != theirs
    ]


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


@pytest.mark.corpus
@pytest.mark.skipif(not ORACLE.is_file(), reason="the corpus is not beside the checkout")
def test_classes_are_those_of_rosidl():
    """Compares names, types, constants, defaults and the repr of every class."""
    found, compared, incomplete = [], 0, 0
    for line in ORACLE.read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        source = repository(row["path"].split("/")[0])
        try:
            module = _Builder(source.load, lambda _: "").build(
                read_definition(CORPUS / row["path"])
            )
        except DefinitionError:
            incomplete += 1
            continue
        compared += 1
        found += differences(row, getattr(module, row["type"].split("/")[2]))
    assert not found, "\n".join(found[:10])
    assert compared > 1300
    assert incomplete < compared / 10
