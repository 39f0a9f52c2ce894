"""Nodes that a launch file starts."""

import importlib

import pytest

from taskrpc.ros.missing import WHAT_RUNS


@pytest.fixture
def ros(launch):
    return importlib.import_module("launch_ros.actions")


async def test_program_that_is_not_here_is_named_once_and_the_rest_starts(launch, ros, play):
    viewer = {"package": "rviz2", "executable": "rviz2"}
    after = launch.actions.LogInfo(msg="the rest")
    assert await play(ros.Node(**viewer), ros.Node(**viewer), after) == (
        0,
        [
            "[WARNING] [launch]: taskrpc does not have 'rviz2' of the package 'rviz2', so it is"
            " not started; the other programs start (taskrpc has no rviz2; start it on a real"
            " ROS 2)",
            "[INFO] [launch.user]: the rest",
        ],
    )


async def test_program_in_cpp_is_left_out_with_what_runs_here(ros, play, tmp_path, monkeypatch):
    package = tmp_path / "src" / "waves"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>waves</name></package>")
    (package / "CMakeLists.txt").write_text("add_executable(wave src/wave.cpp)\n")
    monkeypatch.chdir(tmp_path)
    assert await play(ros.Node(package="waves", executable="wave")) == (
        0,
        [
            "[WARNING] [launch]: 'wave' of the package 'waves' is a compiled program, so it is not"
            f" started; the other programs start ({WHAT_RUNS})"
        ],
    )


async def test_misspelt_package_is_an_error(ros, play):
    code, (line,) = await play(ros.Node(package="demo_node_py", executable="talker"))
    assert code == 1
    assert "package 'demo_node_py' not found; did you mean demo_nodes_py" in line


async def test_invalid_name_is_an_error(ros, play):
    node = ros.Node(package="demo_nodes_py", executable="talker", name="a b")
    code, (line,) = await play(node)
    assert code == 1
    assert "Invalid node name" in line


@pytest.mark.parametrize(
    ("outer", "inner", "joined"),
    [
        ("", "", ""),
        ("", "a", "/a"),
        ("/a", "b", "/a/b"),
        ("/a", "/b", "/b"),
        ("/a", "", "/a"),
        ("/a", "/", "/"),
    ],
)
def test_namespaces_are_joined(launch, outer, inner, joined):
    parameters = importlib.import_module("launch_ros.parameters")
    assert parameters.joined_namespace(outer, inner) == joined


def test_settings_end_with_their_group(launch, ros):
    context = launch.LaunchContext()
    show = []

    def look(context):
        node = ros.Node(package="demo_nodes_py", executable="talker")
        show.append(node.prepare_command(context).shown[4:])

    see = launch.actions.OpaqueFunction(function=look)
    group = launch.actions.GroupAction(
        [
            ros.PushRosNamespace("a"),
            ros.SetParameter("p", True),
            ros.SetParameter("p", "x"),
            ros.SetRemap("b", "c"),
            see,
        ]
    )
    launch.utilities.visit_all_entities_and_collect_futures(group, context)
    launch.utilities.visit_all_entities_and_collect_futures(see, context)
    inside = ["--ros-args", "-r", "__ns:=/a", "-p", "p:=x", "-r", "b:=c"]
    assert show == [inside, []]


async def test_components_are_named(launch, ros, play):
    from launch_ros.descriptions import ComposableNode

    container = ros.ComposableNodeContainer(
        name="c",
        namespace="",
        package="rclcpp_components",
        executable="component_container",
        composable_node_descriptions=[ComposableNode(package="p", plugin="p::Camera")],
    )
    assert (await play(container))[1] == [
        "[WARNING] [launch]: taskrpc has no compiled components, so it does not start the container"
        " 'c' (p::Camera); the other programs start"
    ]


@pytest.mark.real_time
async def test_node_of_the_workspace_starts_with_its_parameters(launch, ros, play, tmp_path):
    folder = tmp_path / "src" / "my_robot"
    (folder / "my_robot").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>my_robot</name></package>")
    (folder / "setup.py").write_text(
        "setup(entry_points={'console_scripts': ['show = my_robot.show:main']})"
    )
    (folder / "my_robot" / "__init__.py").write_text("")
    (folder / "my_robot" / "show.py").write_text(
        "import rclpy\ndef main():\n    rclpy.init()\n    node = rclpy.create_node('x')\n"
        "    node.declare_parameter('speed', 0.0)\n"
        "    print(node.get_fully_qualified_name(), node.get_parameter('speed').value)\n"
    )
    importlib.import_module("taskrpc.ros.hook").install(folder)
    node = ros.Node(
        package="my_robot",
        executable="show",
        name="shown",
        namespace="here",
        parameters=[{"speed": launch.substitutions.LaunchConfiguration("v")}],
        output="screen",
    )
    _, lines = await play(node, v="2.5")
    assert "[show-1] /here/shown 2.5" in lines, lines


async def test_missing_parameter_file_is_named_and_the_node_starts(launch, ros, tmp_path, capsys):
    node = ros.Node(package="demo_nodes_py", executable="talker", parameters=["nope.yaml"])
    prepared = node.prepare_command(launch.LaunchContext())
    assert prepared.shown == ["taskrpc", "run", "demo_nodes_py", "talker"]
    said = "[WARNING] [launch]: Parameter file path is not a file: nope.yaml\n"
    assert capsys.readouterr().out == said


@pytest.mark.parametrize(
    "line",
    [
        "from launch.condition import Condition",
        "from launch.events.process.process_exited import ProcessExited",
        "from launch.some_actions_type import SomeActionsType",
        "from launch.some_entities_type import SomeEntitiesType",
        "from launch.substitutions import LaunchLogDir",
        "from launch_ros.actions.node import Node, ParameterFile",
        "from launch_ros.descriptions.composable_node import ComposableNode",
        "from launch_ros.parameters_type import SomeParameters",
        "from launch_ros.remap_rule_type import SomeRemapRules",
    ],
)
def test_names_of_ros_modules_are_importable(ros, line):
    exec(line, {})


@pytest.mark.parametrize(
    "name",
    [
        "talker_listener.launch.py",
        "talker_listener_launch.py",
        "talker_listener_launch.xml",
        "talker_listener_launch.yaml",
    ],
)
async def test_launch_files_of_demo_nodes_cpp_start_two_nodes(launch, ros, play, name, monkeypatch):
    started = []
    monkeypatch.setattr(ros.Node, "prepare_command", lambda node, _: started.append(node))
    share = importlib.import_module("launch_ros.substitutions").FindPackageShare("demo_nodes_cpp")
    path = launch.substitutions.PathJoinSubstitution([share, "launch", "topics", name])
    assert await play(launch.actions.IncludeLaunchDescription(path)) == (0, [])
    names = [each.node_executable[0].text for each in started]
    assert names == ["talker", "listener"]
