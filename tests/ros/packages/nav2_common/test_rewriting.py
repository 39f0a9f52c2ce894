"""Parameter files get other values and keys."""

import importlib

import pytest


@pytest.fixture
def rewritten(ros_names):
    def rewritten(data, parameters=(), *, keys=(), values=(), converts_numbers=True):
        module = importlib.import_module("nav2_common.rewriting")
        settings = {"keys": dict(keys), "values": dict(values)}
        return module.rewritten(
            data, dict(parameters), converts_numbers=converts_numbers, **settings
        )

    return rewritten


def nodes(**parameters):
    return {"amcl": {"ros__parameters": parameters}}


def test_name_changes_the_parameter_of_all_nodes(rewritten):
    data = {**nodes(speed=1.0, other="a"), "b": {"ros__parameters": {"speed": 2}}}
    assert rewritten(data, {"speed": "0.5", "unknown": "1"}) == {
        **nodes(speed=0.5, other="a"),
        "b": {"ros__parameters": {"speed": 0.5}},
    }


def test_path_changes_one_parameter_and_adds_a_missing_one(rewritten):
    path = "amcl.ros__parameters."
    changes = {path + "speed": "3", path + "new.inner": "x", "no.such": "1"}
    found = rewritten(nodes(speed=1), changes)
    assert found == nodes(speed=3, new={"inner": "x"})
    assert rewritten(None, {"b.ros__parameters.c": "true"}) == {
        "b": {"ros__parameters": {"c": True}}
    }


@pytest.mark.parametrize(
    ("text", "value"),
    [("3", 3), ("3.5", 3.5), ("True", True), ("false", False), ("1.2.3", "1.2.3"), ("", "")],
)
def test_texts_become_numbers_only_if_that_is_wanted(rewritten, text, value):
    assert rewritten(nodes(a="x"), {"a": text}) == nodes(a=value)
    kept = value if isinstance(value, bool) else text
    assert rewritten(nodes(a="x"), {"a": text}, converts_numbers=False) == nodes(a=kept)


def test_keys_and_values_are_renamed(rewritten):
    data = nodes(frame="base", topics=["base", "odom"])
    assert rewritten(data, keys={"amcl": "loc"}, values={"base": "robot/base"}) == {
        "loc": {"ros__parameters": {"frame": "robot/base", "topics": ["robot/base", "odom"]}}
    }
