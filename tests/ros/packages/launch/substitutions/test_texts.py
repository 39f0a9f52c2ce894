"""Substitutions that join and compare texts."""

import os

import pytest


def test_paths_are_joined_and_extended(launch, perform):
    join = launch.substitutions.PathJoinSubstitution
    assert perform(join(["a", ["b", "c"]]) / "d") == os.path.join("a", "bc", "d")
    assert perform(launch.substitutions.PathSubstitution("a") / "b") == os.path.join("a", "b")


def test_texts_are_joined_with_a_delimiter(launch, perform):
    join = launch.substitutions.StringJoinSubstitution
    assert perform(join(["a", ["b", "c"]], delimiter="-")) == "a-bc"


@pytest.mark.parametrize(
    ("left", "right", "equal"),
    [("a", "a", True), (1, "1.0", True), (True, "true", True), ("a", "b", False), ("1", 2, False)],
)
def test_values_are_compared(launch, perform, left, right, equal):
    s = launch.substitutions
    assert perform(s.EqualsSubstitution(left, right)) == str(equal).lower()
    assert perform(s.NotEqualsSubstitution(left, right)) == str(not equal).lower()


def test_truths_are_combined(launch, perform):
    s = launch.substitutions
    assert perform(s.AndSubstitution("true", "false")) == "false"
    assert perform(s.OrSubstitution("false", "1")) == "true"
    assert perform(s.NotSubstitution("0")) == "true"
    assert perform(s.AnySubstitution("0", "0", "1")) == "true"
    assert perform(s.AllSubstitution("1", "0")) == "false"
    assert perform(s.IfElseSubstitution("1", "a", "b")) == "a"
