"""Errors name the line of the launch file, also if they happen long after it was read."""

import pytest

HEAD = """\
from launch import LaunchDescription
from launch.actions import *
from launch.conditions import IfCondition
from launch_ros.actions import *

def generate_launch_description():
    return LaunchDescription([
        """


@pytest.fixture
def problem(launch, play, tmp_path):
    """The error of a launch file with one action, which is in line 8."""

    async def problem(action):
        path = tmp_path / "a.launch.py"
        path.write_text(f"{HEAD}{action}\n    ])\n")
        code, lines = await play(launch.actions.IncludeLaunchDescription(str(path)))
        assert code == 1
        _, _, found = lines[-1].partition(f"{path}, line ")
        number, _, text = found.partition(": ")
        assert number == "8", lines
        return text

    return problem


@pytest.mark.parametrize(
    ("action", "text"),
    [
        ("LogInfo(msg='a', condition='true')", "condition: expected one such as IfCondition("),
        ("LogInfo(msg='a', condition=IfCondition('x'))", "expected condition expression to be"),
        ("ForLoop('x', function=lambda i: [])", "invalid literal for int() with base 10: 'x'"),
        ("GroupAction([5])", "GroupAction() expected actions, got 5"),
        ("GroupAction(LogInfo(msg='a'))", "GroupAction() expected a list of actions, got <"),
        ("GroupAction([ForLoop('x', function=print)])", "invalid literal for int() with base"),
        ("RegisterEventHandler(5)", "RegisterEventHandler() expected a handler, got 5"),
        ("ExecuteProcess(cmd=[])", "cmd: expected a program and its arguments, got an empty"),
        ("ExecuteProcess(cmd=['a'], respawn_delay='x')", "respawn_delay: expected a number: "),
        ("ExecuteProcess(cmd=['a'], sigterm_timeout='x')", "sigterm_timeout: expected a number"),
        ("ExecuteProcess(cmd=['a'], respawn_max_retries=[])", "respawn_max_retries: expected a n"),
        ("ExecuteProcess(cmd=['a'], output_format='{no}')", "output_format: expected a format w"),
        ("Node(executable='a', remappings=[('/b',)])", "remappings: expected pairs of an old"),
        ("Node(executable='a', remappings=('b', 'c'))", "remappings: expected pairs of an old"),
        ("Node(executable='a', parameters=[{'b': print}])", "parameter b: expected a number, a"),
        ("SetParameter('b', print)", "the value of a parameter: expected a number, a truth"),
        ("Node(executable='a', name='b c')", "Node: Invalid node name: node name must not"),
    ],
)
async def test_error_of_an_action_names_the_line_that_creates_it(problem, action, text):
    assert text in await problem(action)


async def test_list_with_a_wrong_element_is_an_error(launch):
    for wrong in (5, None, "LogInfo", [launch.actions.LogInfo(msg="a")]):
        with pytest.raises(TypeError, match=r"LaunchDescription\(\) expected actions, got "):
            launch.LaunchDescription([wrong])
    with pytest.raises(TypeError, match="LaunchDescription expected actions, got 5"):
        launch.LaunchDescription().add_action(5)
