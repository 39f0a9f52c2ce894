"""Values of parameters in launch files, and parameter files."""

import importlib

import pytest


@pytest.fixture
def ros(launch):
    return importlib.import_module("launch_ros.parameter_descriptions")


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ("3", 3),
        ("text", "text"),
        ("true", True),
        (2.5, 2.5),
        ([1, 2], [1, 2]),
        (["1", "b"], ["1", "b"]),
        ("[1, 2]", [1, 2]),
        ("", ""),
    ],
)
def test_texts_become_what_yaml_makes_of_them(launch, ros, given, value):
    assert ros.value_of(launch.LaunchContext(), "p", given) == value


def test_value_has_the_given_type(launch, ros):
    context = launch.LaunchContext()
    assert ros.ParameterValue("3", value_type=str).evaluate(context) == "3"
    assert ros.ParameterValue(["1", ".5"], value_type=float).evaluate(context) == 1.5
    assert ros.Parameter(["a", "b"], "3").evaluate(context) == ("ab", 3)
    with pytest.raises(TypeError, match=r"try wrapping it in launch_ros.parameter_descriptions"):
        ros.value_of(context, "p", "a: b: c")


async def test_substitutions_in_a_parameter_file_are_replaced(launch, ros, tmp_path):
    path, context = tmp_path / "p.yaml", launch.LaunchContext()
    path.write_text("/**:\n  ros__parameters: {a: $(var x)}\n")
    context.launch_configurations["x"] = "5"
    assert ros.ParameterFile(str(path)).evaluate(context) == path
    replaced = ros.ParameterFile(str(path), allow_substs=True).evaluate(context)
    assert replaced.read_text() == "/**:\n  ros__parameters: {a: 5}\n"
    for end in context.at_end:
        await end()
    assert not replaced.exists()
