"""The bundled definitions have the fields, constants, defaults and hashes of ROS 2."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from srvgen.definitions.model import Definition, MessageDef, sections
from srvgen.files.search import BUNDLED, Search
from srvgen.typehash import hash_of

CORPUS = Path(__file__).parents[3] / "shared" / "corpus"
HASHES = Path(__file__).with_name("bundled_hashes.txt")

OURS = {"my_robot_interfaces", "taskrpc_interfaces"}
"""Packages that ROS 2 does not have."""

NEWER_THAN_CORPUS = {
    "nav_msgs/msg/Goals",
    "rosapi_msgs/srv/DeleteParam",
    "rosapi_msgs/srv/GetParam",
    "rosapi_msgs/srv/Interfaces",
    "rosapi_msgs/srv/SetParam",
}
"""Types whose files are newer than the corpus; their hashes prove their fields."""

FILES = {
    f"{path.parts[-3]}/{path.parts[-2]}/{path.stem}": path
    for path in sorted(BUNDLED.glob("*/*/*.*"))
}
FROM_ROS = [name for name in FILES if name.split("/")[0] not in OURS]
OFFICIAL = dict(
    line.split()
    for line in HASHES.read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
)
IN_CORPUS = [
    name for name in FROM_ROS if name not in NEWER_THAN_CORPUS and not name.startswith("tf2_msgs/")
]

OFFICIAL_FILES = (
    "ros2__",
    "ros__ros_tutorials@rolling",
    "RobotWebTools__rosbridge_suite/rosapi_msgs",
)
"""The beginnings of the corpus paths of the official definition files."""

# The bundle as a given path: no package of the same name elsewhere can come before it.
search = Search([BUNDLED])


@cache
def load(name: str) -> Definition:
    return search.load(name)


@pytest.mark.parametrize("name", OFFICIAL)
def test_bundled_or_derived_type_has_the_hash_of_ros_2(name):
    assert hash_of(load(name), load) == OFFICIAL[name]


@pytest.mark.parametrize("name", [name for name in FILES if name not in FROM_ROS])
def test_a_bundled_type_without_an_official_hash_resolves(name):
    assert hash_of(load(name), load).startswith("RIHS01_")


def test_every_type_of_ros_has_an_official_hash_and_every_hash_a_type():
    # Only the names of derived types have an underscore: AddTwoInts_Request.
    own = {f"{name.rpartition('/')[0]}/{Path(name).name.partition('_')[0]}" for name in OFFICIAL}
    assert own == set(FROM_ROS)


BARE = {"example_interfaces/srv/AddTwoInts", "std_srvs/srv/Empty"}
"""Tutorials show these files, which have no comment in ROS 2 either."""


@pytest.mark.parametrize("name", FROM_ROS)
def test_bundled_file_begins_with_a_short_comment(name):
    text = FILES[name].read_bytes().decode("utf-8")
    assert next(sections(load(name))).comment or name in BARE
    assert max(map(len, text.splitlines())) <= 100
    assert text.endswith("\n")
    assert not text.startswith("\ufeff")


@pytest.mark.skipif(not CORPUS.exists(), reason="the corpus is not beside this checkout")
@pytest.mark.parametrize("name", IN_CORPUS)
def test_fields_constants_and_defaults_are_those_of_the_official_file(name):
    """A hash does not depend on constants and defaults, so hashes cannot test them."""
    assert [outline(section) for section in sections(load(name))] == official_outlines()[name]


def outline(message: MessageDef) -> dict[str, list[tuple[object, ...]]]:
    return {
        "fields": [(field.name, str(field.type), field.default) for field in message.fields],
        "constants": [(item.name, item.type, item.value) for item in message.constants],
    }


@cache
def official_outlines() -> dict[str, list[dict[str, list[tuple[object, ...]]]]]:
    """ROS 2's own definitions as ROS 2's own parser reads them, section by section."""
    lines = (CORPUS / "oracles" / "parse.jsonl").read_text(encoding="utf-8").splitlines()
    return {
        f"{row['package']}/{row['kind']}/{row['name']}": [
            official_outline(section) for section in row["spec"].values()
        ]
        for row in map(json.loads, lines)
        if row["path"].startswith(OFFICIAL_FILES) and row.get("spec")
    }


def official_outline(spec: dict[str, list[dict]]) -> dict[str, list[tuple[object, ...]]]:
    return {
        "fields": [
            (item["name"], item["type_string"], as_value(item["default"]))
            for item in spec["fields"]
        ],
        "constants": [(item["name"], item["type"], item["value"]) for item in spec["constants"]],
    }


def as_value(default: object) -> object:
    return tuple(default) if isinstance(default, list) else default
