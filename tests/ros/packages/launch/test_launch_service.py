"""The service executes launch files to their end, and reports their errors in one line."""

import asyncio
import sys

import pytest


async def test_launch_ends_when_there_is_nothing_left_to_do(launch, play):
    assert await play(launch.actions.LogInfo(msg=["a", "b"])) == (0, ["[INFO] [launch.user]: ab"])


async def test_error_in_an_action_is_one_line_with_its_place_and_ends_the_launch(launch, play):
    action = launch.actions.LogInfo(msg=launch.substitutions.LaunchConfiguration("nope"))
    code, lines = await play(action, launch.actions.LogInfo(msg="not reached"))
    assert code == 1
    line = test_error_in_an_action_is_one_line_with_its_place_and_ends_the_launch.__code__
    assert lines == [
        "[ERROR] [launch]: Caught exception in launch (see debug for traceback):"
        f" {__file__}, line {line.co_firstlineno + 1}:"
        " launch configuration 'nope' does not exist"
    ]


async def test_error_in_a_python_launch_file_names_its_line(launch, play, tmp_path):
    path = tmp_path / "a.launch.py"
    path.write_text("def generate_launch_description():\n    return [][3]\n")
    source = launch.launch_description_sources.PythonLaunchDescriptionSource(str(path))
    code, lines = await play(launch.actions.IncludeLaunchDescription(source))
    assert code == 1
    assert lines[0].endswith(f": {path}, line 2: IndexError: list index out of range")
    path.write_text("x = (\n")
    code, lines = await play(launch.actions.IncludeLaunchDescription(str(path)))
    assert f": {path}, line 1: SyntaxError: " in lines[0]
    path.write_text("x = 1\n")
    code, lines = await play(launch.actions.IncludeLaunchDescription(str(path)))
    assert "does not contain the required function 'generate_launch_description()'" in lines[0]
    code, lines = await play(launch.actions.IncludeLaunchDescription("nope.launch.py"))
    assert lines[0].endswith("No such file or directory: 'nope.launch.py'")


async def test_other_tasks_can_add_descriptions_and_shut_down(launch, capsys):
    service = launch.LaunchService()
    running = asyncio.ensure_future(service.run_async(shutdown_when_idle=False))
    await asyncio.sleep(5)
    message = launch.actions.LogInfo(msg="late")
    service.include_launch_description(launch.LaunchDescription([message]))
    await asyncio.sleep(5)
    assert not running.done()
    service.shutdown()
    assert await running == 0
    assert capsys.readouterr().out == "[INFO] [launch.user]: late\n"


async def test_class_is_importable_from_the_module_of_its_name(launch):
    from launch.actions.declare_launch_argument import DeclareLaunchArgument
    from launch.conditions.if_condition import IfCondition
    from launch.event_handlers.on_process_exit import OnProcessExit

    assert DeclareLaunchArgument is launch.actions.DeclareLaunchArgument
    assert IfCondition is launch.conditions.IfCondition
    assert OnProcessExit is launch.event_handlers.OnProcessExit


@pytest.mark.real_time
async def test_no_process_survives_the_launch(launch, play, tmp_path):
    """A program leaves a child of its own behind, which ignores SIGINT."""
    if sys.platform == "win32":
        pytest.skip("a job object ends the processes there")
    child = "import signal, time; signal.signal(2, signal.SIG_IGN); time.sleep(600)"
    program = (
        "import subprocess, sys\n"
        f"child = subprocess.Popen([sys.executable, '-c', {child!r}])\n"
        "print(child.pid, flush=True)\n"
    )
    start = launch.actions.ExecuteProcess(cmd=[sys.executable, "-c", program], output="screen")
    code, lines = await play(start)
    assert code == 0
    pid = next(line.partition("] ")[2] for line in lines if line.partition("] ")[2].isdigit())
    with pytest.raises(ProcessLookupError):
        await _wait_until_gone(int(pid))


async def _wait_until_gone(pid):
    import os

    for _ in range(100):
        os.kill(pid, 0)
        await asyncio.sleep(0.05)
