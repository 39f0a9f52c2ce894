"""Launch arguments, configurations and environment variables."""

import os

import pytest


def value(launch, name):
    return launch.actions.LogInfo(msg=launch.substitutions.LaunchConfiguration(name))


async def test_argument_has_its_default_or_the_given_value(launch, play):
    declared = launch.actions.DeclareLaunchArgument("robot", default_value=["r", "2"])
    assert (await play(declared, value(launch, "robot")))[1] == ["[INFO] [launch.user]: r2"]
    _, lines = await play(declared, value(launch, "robot"), robot="d2")
    assert lines == ["[INFO] [launch.user]: d2"]


async def test_missing_and_invalid_arguments_are_named(launch, play):
    declare = launch.actions.DeclareLaunchArgument
    code, (line,) = await play(declare("robot", description="which one"))
    assert code == 1
    assert line.endswith(
        "Required launch argument 'robot' (description: 'which one') was not provided"
    )
    code, (line,) = await play(declare("robot", choices=["a", "b"]), robot="c")
    assert code == 1
    assert line.endswith(
        "Argument 'robot' provided value 'c' is not valid. Valid options are: ['a', 'b']"
    )
    with pytest.raises(ValueError, match="at least one value"):
        declare("robot", choices=[])


async def test_configurations_are_set_and_removed(launch, play):
    actions = launch.actions
    _, lines = await play(
        actions.SetLaunchConfiguration("a", True),
        value(launch, "a"),
        actions.UnsetLaunchConfiguration("a"),
        actions.LogInfo(msg=launch.substitutions.LaunchConfiguration("a", default="gone")),
    )
    assert lines == ["[INFO] [launch.user]: True", "[INFO] [launch.user]: gone"]


async def test_variables_are_set_extended_and_removed(launch, play):
    actions, seen = launch.actions, []
    see = actions.OpaqueFunction(
        function=lambda context: seen.append(context.environment.get("LAUNCH_T"))
    )
    await play(
        actions.SetEnvironmentVariable("LAUNCH_T", "b"),
        see,
        actions.AppendEnvironmentVariable("LAUNCH_T", "c"),
        actions.AppendEnvironmentVariable("LAUNCH_T", "a", prepend="true", separator="-"),
        see,
        actions.UnsetEnvironmentVariable("LAUNCH_T"),
        see,
    )
    assert seen == ["b", f"a-b{os.pathsep}c", None]


async def test_whole_environment_is_replaced_and_reset(launch, play):
    actions = launch.actions
    before, seen = dict(os.environ), []
    await play(
        actions.ReplaceEnvironmentVariables({"ONLY": "this"}),
        actions.OpaqueFunction(function=lambda context: seen.append(dict(os.environ))),
        actions.ResetEnvironment(),
    )
    assert seen == [{"ONLY": "this"}]
    assert dict(os.environ) == before
