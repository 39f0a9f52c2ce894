"""One launch file executes another one."""

FILE = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("robot"),
        LogInfo(msg=[LaunchConfiguration("robot"), " in ", ThisLaunchFileDir()]),
    ])
"""


async def test_included_file_gets_arguments_and_knows_its_folder(launch, play, tmp_path):
    (tmp_path / "inner.launch.py").write_text(FILE)
    include = launch.actions.IncludeLaunchDescription(
        launch.launch_description_sources.PythonLaunchDescriptionSource(
            [str(tmp_path), "/inner.launch.py"]
        ),
        launch_arguments={"robot": "r2"}.items(),
    )
    outside = launch.actions.LogInfo(msg=launch.substitutions.ThisLaunchFileDir())
    code, lines = await play(include, outside)
    assert lines[0] == f"[INFO] [launch.user]: r2 in {tmp_path}"
    assert "ThisLaunchFileDir used outside of a launch file" in lines[1]
    assert code == 1


async def test_missing_argument_of_the_included_file_is_named(launch, play, tmp_path):
    (tmp_path / "inner.launch.py").write_text(FILE)
    include = launch.actions.IncludeLaunchDescription(str(tmp_path / "inner.launch.py"))
    _, lines = await play(include)
    assert "Included launch description missing required argument 'robot'" in lines[0]
    assert [each.name for each in include.get_sub_entities()[0].get_launch_arguments()] == ["robot"]
