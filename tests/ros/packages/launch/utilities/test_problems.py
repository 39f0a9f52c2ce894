"""Errors of launch files become one line with the place and the next step."""

import pytest

from taskrpc.ros.executables import missing_folder


@pytest.fixture
def line(launch, tmp_path):
    """The line about the error of a launch file with this text; FILE stands for its path."""

    def line(text):
        path = tmp_path / "a.launch.py"
        path.write_text(text)
        sources = launch.launch_description_sources
        with pytest.raises(Exception) as caught:  # noqa: PT011 - of any kind
            sources.get_launch_description_from_python_launch_file(str(path))
        return launch.utilities.problems.explained(caught.value).replace(str(path), "FILE")

    return line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = 1\n1 / 0", "FILE, line 2: ZeroDivisionError: division by zero"),
        ("raise RuntimeError('no camera')", "FILE, line 1: no camera"),
        ("raise RuntimeError('two\\n\\n  lines')", "FILE, line 1: two; lines"),
        ("assert 0", "FILE, line 1: AssertionError"),
        ("x = (", "FILE, line 1: SyntaxError: '(' was never closed"),
        (
            "open('nope.yaml')",
            "FILE, line 1: [Errno 2] No such file or directory: 'nope.yaml'",
        ),
        (
            "import launch_pal_x",
            "FILE, line 1: ModuleNotFoundError: No module named 'launch_pal_x'; if it belongs to"
            " a ROS package, clone the repository of the package into the src folder of your"
            " workspace, otherwise install it with pip",
        ),
        (
            "import os; os.environ['TURTLEBOT3_MODEL_X']",
            "FILE, line 1: KeyError: TURTLEBOT3_MODEL_X; if it is an environment variable, set it"
            " before the launch: TURTLEBOT3_MODEL_X=VALUE",
        ),
        (
            "def f(): f()\nf()",
            "FILE, line 1: too deep: a launch file includes itself, or a function"
            " calls itself without end",
        ),
        (
            "import xacro",
            "FILE, line 1: ModuleNotFoundError: No module named 'xacro'; it is a package of ROS 2"
            " that taskrpc does not have: PyPI has it; run pip install xacro",
        ),
    ],
)
def test_error_in_a_launch_file_has_its_line(line, text, expected):
    assert line(text) == expected


def test_file_of_a_missing_package_names_the_package(line):
    path = missing_folder("my_robot_x") / "urdf" / "a.urdf"
    found = line(f"open({str(path)!r})")
    assert found.startswith("FILE, line 1: [Errno 2] No such file or directory: ")
    assert found.endswith(
        "; taskrpc does not have the package 'my_robot_x': clone the repository of the package"
        " into the src folder of your workspace"
    )
