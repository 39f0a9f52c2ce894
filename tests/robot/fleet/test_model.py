import pytest

from taskrpc.robot.fleet.model import Abilities, Capabilities
from tests.robot.fleet.fakes import robot


@pytest.mark.parametrize(
    ("text", "allowed", "refused"),
    [
        ("", [("move", "dock"), ("scan", "x")], []),
        ("move", [("move", "dock"), ("move", " dock ")], [("scan", "dock")]),
        ("scan:area_*, *:dock", [("scan", "area_a"), ("move", "dock")], [("scan", "b")]),
        ("move:lab_?", [("move", "lab_1")], [("move", "lab_10"), ("move", "LAB_1")]),
    ],
)
def test_capabilities_allow_types_and_targets(text, allowed, refused):
    capabilities = Capabilities(text)
    assert all(capabilities.allow(*each) for each in allowed)
    assert not any(capabilities.allow(*each) for each in refused)


@pytest.mark.parametrize("text", ["move,,scan", "move:", ":dock", ","])
def test_capabilities_with_an_empty_part_are_refused(text):
    with pytest.raises(ValueError, match="expected a list such as move"):
        Capabilities(text)


@pytest.mark.parametrize(
    ("text", "places", "unused"),
    [
        ("", ["dock"], []),
        ("move,scan:area_*,*:dock", ["dock"], []),
        ("mov,scan:dokc,move", ["dock"], ["mov", "scan:dokc"]),
        ("scan:dokc,fly:dock", [], ["fly:dock"]),
    ],
)
def test_misspelled_capabilities_are_found(text, places, unused):
    assert Capabilities(text).unused(["move", "scan"], places) == unused


def test_place_that_only_one_robot_knows_is_out_of_reach_for_the_others():
    robots = [robot("a", places=("dock", "lab")), robot("b", places=("dock",)), robot("c")]
    abilities = Abilities(robots)
    assert abilities.of("move", "lab") == {"a", "c"}
    assert abilities.of("move", "dock") == {"a", "b", "c"}
    assert abilities.of("move", "2,3") == {"a", "b", "c"}


def test_task_type_that_a_robot_lacks_is_not_for_it():
    robots = [robot("a", task_types=("fly",)), robot("b", capabilities="scan")]
    assert Abilities(robots).of("move", "1") == frozenset()
    assert Abilities(robots).of("fly", "1") == {"a"}


def test_robot_is_live_until_its_lease_ends():
    known = robot("a", lease_until=10.0)
    assert known.is_live(9.9)
    assert not known.is_live(10.0)
    assert not robot("a", is_gone=True).is_live(0.0)
