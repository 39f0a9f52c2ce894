"""What ROS's tutorials about launch files do, in virtual time and with programs that are fakes."""

import asyncio
import importlib
import sys
from typing import ClassVar

import pytest

from taskrpc.cli.ros.launch import file_in_package


class FakeTree:
    """A program that writes and ends as the test says, by the executable's name."""

    started: ClassVar = []
    scripts: ClassVar = {}
    """By name: the seconds until the end, and what is written after how many seconds."""

    def __init__(self, command):
        self.command = command
        self.pid = 100 + len(self.started)
        self.returncode = None
        self.end = asyncio.get_running_loop().create_future()

    def has_processes(self):
        return self.returncode is None

    @classmethod
    async def start(cls, command, on_output, *, cwd=None, env=None, has_terminal=False):
        words = command.split() if isinstance(command, str) else command
        tree = cls([each for each in words if each not in (sys.executable, "-m", "taskrpc")])
        cls.started.append(tree)
        loop = asyncio.get_running_loop()
        name = next((each for each in cls.scripts if each in tree.command), None)
        seconds, output = cls.scripts.get(name, (None, ()))
        for after, text in output:
            loop.call_later(after, on_output, 1, text)
        if seconds is not None:
            loop.call_later(seconds, tree.ends, 0)
        return tree

    def ends(self, code):
        if not self.end.done():
            self.returncode = code
            self.end.set_result(code)

    async def wait(self):
        return await self.end

    def send_signal(self, number):
        self.ends(0)

    async def end_descendants(self):
        pass


@pytest.fixture
def started(launch, monkeypatch):
    """Plays launch files; returns the commands, and the lines on the screen."""
    monkeypatch.setattr(FakeTree, "started", [])
    monkeypatch.setattr(FakeTree, "scripts", {})
    module = importlib.import_module("launch.actions.execute_local")
    monkeypatch.setattr(module, "ProcessTree", FakeTree)
    return FakeTree.started


@pytest.fixture
def launched(launch, started, tmp_path, capsys):
    """Executes a launch file for some seconds, then shuts it down, as Ctrl-C does."""

    async def launched(name, text, *, seconds=60.0, **arguments):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        service = launch.LaunchService()
        include = launch.actions.IncludeLaunchDescription(
            str(path), launch_arguments=arguments.items()
        )
        service.include_launch_description(launch.LaunchDescription([include]))
        asyncio.get_running_loop().call_later(seconds, service.shutdown)
        assert await service.run_async() == 0
        lines = capsys.readouterr().out.splitlines()
        return [" ".join(tree.command) for tree in started], lines

    return launched


# Creating a launch file

MIMIC_PY = """
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    windows = [Node(package="turtlesim", namespace=f"turtlesim{n}", executable="turtlesim_node",
                    name="sim") for n in (1, 2)]
    follower = Node(package="turtlesim", executable="mimic", name="mimic", remappings=[
        ("/input/pose", "/turtlesim1/turtle1/pose"),
        ("/output/cmd_vel", "/turtlesim2/turtle1/cmd_vel")])
    return LaunchDescription([*windows, follower])
"""
MIMIC_XML = """
<launch>
  <node pkg="turtlesim" exec="turtlesim_node" name="sim" namespace="turtlesim1"/>
  <node pkg="turtlesim" exec="turtlesim_node" name="sim" namespace="turtlesim2"/>
  <node pkg="turtlesim" exec="mimic" name="mimic">
    <remap from="/input/pose" to="/turtlesim1/turtle1/pose"/>
    <remap from="/output/cmd_vel" to="/turtlesim2/turtle1/cmd_vel"/>
  </node>
</launch>
"""
MIMIC_YAML = """
%YAML 1.2
---
launch:
- node: {pkg: "turtlesim", exec: "turtlesim_node", name: "sim", namespace: "turtlesim1"}
- node: {pkg: "turtlesim", exec: "turtlesim_node", name: "sim", namespace: "turtlesim2"}
- node:
    pkg: "turtlesim"
    exec: "mimic"
    name: "mimic"
    remap:
    - from: "/input/pose"
      to: "/turtlesim1/turtle1/pose"
    - from: "/output/cmd_vel"
      to: "/turtlesim2/turtle1/cmd_vel"
"""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("mimic_launch.py", MIMIC_PY),
        ("mimic_launch.xml", MIMIC_XML),
        ("mimic_launch.yaml", MIMIC_YAML),
    ],
)
async def test_creating_a_launch_file(launched, name, text):
    commands, lines = await launched(name, text)
    assert commands == [
        "run turtlesim turtlesim_node --ros-args -r __node:=sim -r __ns:=/turtlesim1",
        "run turtlesim turtlesim_node --ros-args -r __node:=sim -r __ns:=/turtlesim2",
        "run turtlesim mimic --ros-args -r __node:=mimic"
        " -r /input/pose:=/turtlesim1/turtle1/pose"
        " -r /output/cmd_vel:=/turtlesim2/turtle1/cmd_vel",
    ]
    assert lines[:3] == [
        "[INFO] [turtlesim_node-1]: process started with pid [100]",
        "[INFO] [turtlesim_node-2]: process started with pid [101]",
        "[INFO] [mimic-3]: process started with pid [102]",
    ]


# Integrating launch files into packages


async def test_integrating_launch_files_into_packages(launched, tmp_path, monkeypatch):
    package = tmp_path / "src" / "py_launch_example"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>py_launch_example</name></package>")
    text = '<launch><node pkg="demo_nodes_cpp" exec="talker" name="talker"/></launch>'
    place = "src/py_launch_example/launch/my_script_launch.xml"
    commands, _ = await launched(place, text)
    assert commands == ["run demo_nodes_cpp talker --ros-args -r __node:=talker"]
    monkeypatch.chdir(tmp_path)
    assert file_in_package("py_launch_example", "my_script_launch.xml") == tmp_path / place


# Using substitutions

SUBSTITUTIONS = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, TimerAction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

def generate_launch_description():
    space, use, red = (LaunchConfiguration(name) for name in ("turtlesim_ns", "use", "red"))

    def change(value, **options):
        words = ["ros2 param set ", space, "/sim background_r ", value]
        return ExecuteProcess(cmd=[words], shell=True, **options)

    return LaunchDescription([
        DeclareLaunchArgument("turtlesim_ns", default_value="turtlesim1"),
        DeclareLaunchArgument("use", default_value="False"),
        DeclareLaunchArgument("red", default_value="200"),
        Node(package="turtlesim", namespace=space, executable="turtlesim_node", name="sim"),
        ExecuteProcess(shell=True, cmd=[["ros2 service call ", space, "/spawn ",
            "turtlesim/srv/Spawn ", '"{x: 2, y: 2, theta: 0.2}"']]),
        change("120"),
        TimerAction(period=2.0, actions=[
            change(red, condition=IfCondition(PythonExpression([red, " == 200 and ", use])))]),
    ])
"""
MAIN = """
<launch>
  <let name="background_r" value="200"/>
  <include file="$(dirname)/example_substitutions_launch.py">
    <arg name="turtlesim_ns" value="turtlesim2"/>
    <arg name="use" value="True"/>
    <arg name="red" value="$(var background_r)"/>
  </include>
</launch>
"""


async def test_using_substitutions(launched, started, tmp_path):
    name = "example_substitutions_launch.py"
    commands, _ = await launched(name, SUBSTITUTIONS)
    assert commands == [
        "run turtlesim turtlesim_node --ros-args -r __node:=sim -r __ns:=/turtlesim1",
        'ros2 service call turtlesim1/spawn turtlesim/srv/Spawn "{x: 2, y: 2, theta: 0.2}"',
        "ros2 param set turtlesim1/sim background_r 120",
    ]
    started.clear()
    commands, _ = await launched("example_main_launch.xml", MAIN)
    assert commands[-2:] == [
        "ros2 param set turtlesim2/sim background_r 120",
        "ros2 param set turtlesim2/sim background_r 200",
    ]


# Using event handlers

EVENT_HANDLERS = """
from launch import LaunchDescription
from launch.actions import (EmitEvent, ExecuteProcess, LogInfo, RegisterEventHandler, TimerAction)
from launch.event_handlers import (
    OnExecutionComplete, OnProcessExit, OnProcessIO, OnProcessStart, OnShutdown)
from launch.events import Shutdown
from launch.substitutions import EnvironmentVariable, FindExecutable, LocalSubstitution
from launch_ros.actions import Node

def generate_launch_description():
    window = Node(package="turtlesim", executable="turtlesim_node", name="sim")
    spawn = ExecuteProcess(cmd=["spawn_turtle"])
    change = ExecuteProcess(cmd=["change_red"])
    on = RegisterEventHandler
    return LaunchDescription([
        window,
        on(OnProcessStart(target_action=window, on_start=[LogInfo(msg="window is open"), spawn])),
        on(OnProcessIO(target_action=spawn, on_stdout=lambda event: LogInfo(
            msg="spawn request says " + event.text.decode().strip()))),
        on(OnExecutionComplete(target_action=spawn, on_completion=[
            LogInfo(msg="turtle is there"),
            TimerAction(period=2.0, actions=[change])])),
        on(OnProcessExit(target_action=window, on_exit=[
            LogInfo(msg=[EnvironmentVariable("LAUNCH_USER"), " closed the window"]),
            EmitEvent(event=Shutdown(reason="Window closed"))])),
        on(OnShutdown(on_shutdown=[LogInfo(
            msg=["asked to shut down: ", LocalSubstitution("event.reason")])])),
    ])
"""


async def test_using_event_handlers(launched, monkeypatch):
    monkeypatch.setenv("LAUNCH_USER", "eve")
    FakeTree.scripts.update(
        {
            "turtlesim_node": (30, ()),
            "spawn_turtle": (5, [(1, b"turtle2\n")]),
            "change_red": (1, ()),
        }
    )
    commands, lines = await launched("handlers.launch.py", EVENT_HANDLERS, seconds=600)
    assert commands[1:] == ["spawn_turtle", "change_red"]
    assert [line.removeprefix("[INFO] ") for line in lines if "[turtlesim_node" not in line] == [
        "[launch.user]: window is open",
        "[spawn_turtle-2]: process started with pid [101]",
        "[launch.user]: spawn request says turtle2",
        "[spawn_turtle-2]: process has finished cleanly [pid 101]",
        "[launch.user]: turtle is there",
        "[change_red-3]: process started with pid [102]",
        "[change_red-3]: process has finished cleanly [pid 102]",
        "[launch.user]: eve closed the window",
        "[launch.user]: asked to shut down: Window closed",
    ]


# Managing large projects

LARGE = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.substitutions import (
    EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution, TextSubstitution,
    ThisLaunchFileDir)
from launch_ros.actions import Node, PushROSNamespace

def generate_launch_description():
    def part(file, **arguments):
        path = PathJoinSubstitution([ThisLaunchFileDir(), file])
        return IncludeLaunchDescription(path, launch_arguments=arguments.items())

    return LaunchDescription([
        GroupAction([PushROSNamespace("turtlesim2"), part("world.launch.py")]),
        part("world.launch.py", name="other"),
        part("broadcaster.launch.xml", target_frame="carrot1"),
        Node(package="demo_nodes_py", executable="listener",
             namespace=EnvironmentVariable("LAUNCH_USER"),
             arguments=["-d", PathJoinSubstitution([ThisLaunchFileDir(), "a.rviz"])]),
    ])
"""
WORLD = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("name", default_value="sim"),
        Node(package="turtlesim", executable="turtlesim_node", name=LaunchConfiguration("name"),
             parameters=[PathJoinSubstitution([ThisLaunchFileDir(), "turtles.yaml"])]),
    ])
"""
BROADCASTER = """
<launch>
  <arg name="target_frame" default="turtle1" description="which frame"/>
  <node pkg="robot_state_publisher" exec="publish" name="one"/>
  <node pkg="robot_state_publisher" exec="publish" name="two"/>
  <node pkg="demo_nodes_py" exec="talker"><param name="frame" value="$(var target_frame)"/></node>
</launch>
"""


async def test_managing_large_projects(launched, tmp_path, monkeypatch):
    monkeypatch.setenv("LAUNCH_USER", "eve")
    (tmp_path / "world.launch.py").write_text(WORLD)
    (tmp_path / "broadcaster.launch.xml").write_text(BROADCASTER)
    colours = tmp_path / "turtles.yaml"
    colours.write_text("/**:\n  ros__parameters:\n    background_b: 255\n")
    commands, lines = await launched("large.launch.py", LARGE)
    world = f"--params-file {colours}"
    assert commands[0] == (
        f"run turtlesim turtlesim_node --ros-args -r __node:=sim -r __ns:=/turtlesim2 {world}"
    )
    assert commands[1] == f"run turtlesim turtlesim_node --ros-args -r __node:=other {world}"
    assert commands[2].startswith("run demo_nodes_py talker --ros-args --params-file ")
    picture = tmp_path / "a.rviz"
    assert commands[3] == f"run demo_nodes_py listener -d {picture} --ros-args -r __ns:=/eve"
    missing = "taskrpc does not have 'publish' of the package 'robot_state_publisher'"
    assert sum(missing in line for line in lines) == 1
