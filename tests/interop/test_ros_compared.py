"""Small programs of many kinds print the same on the real rclpy and here."""

from __future__ import annotations

import sys

import pytest

from tests.interop.conftest import FOLDER
from tests.interop.test_ros_actions import output

PROGRAMS = FOLDER / "compared"
SHARED = "shared.py"
_TYPES = {"0": "NOT_SET", "2": "INTEGER", "3": "DOUBLE", "4": "STRING"}
_UNREGISTERED = (
    "RCLError: Failed to trigger lifecycle state machine transition: Transition is not registered."
)


def _named_types(text: str) -> str:
    """The text of Kilted with the names of parameter types, as Jazzy has them."""
    for number, name in _TYPES.items():
        text = text.replace(f"expected '{number}'", f"expected 'Type.{name}'")
        text = text.replace(f"got '{number}'", f"got 'Type.{name}'")
        text = text.replace(f"Type '{number}'", f"Type 'Type.{name}'")
    return text


DIFFERENT: dict[str, dict[str, str]] = {
    "parameters": {
        # ROS leaves the list of names empty.
        "set undeclared": "ParameterNotDeclaredException: Invalid access to undeclared"
        " parameter(s): ['given']",
        "atomically": "ParameterNotDeclaredException: Invalid access to undeclared"
        " parameter(s): ['no']",
    },
    "fields": {
        # Kilted ignores a misspelled field unless it checks all fields.
        "unknown field": "TypeError: Unexpected keyword argument 'dta'",
        "positional": "TypeError: Extra positional arguments provided",
        "bounded": "AssertionError: The 'int32_values' field must be a set or sequence with length"
        " <= 3 and each value of type 'int' and each integer in [-2147483648, 2147483647]",
        "set constant": "AttributeError: Log.INFO is a constant and cannot be changed",
    },
    # Kilted logs an error and returns ERROR; Jazzy raises.
    "lifecycle": dict.fromkeys(["activate", "configure", "wrong", "after"], _UNREGISTERED),
}
"""What taskrpc does where it differs, by the program and the first words of the line."""


def expected_line(program: str, line: str) -> str:
    """The line of taskrpc for a line of the real rclpy."""
    what, _, result = line.partition(": ")
    ours = DIFFERENT.get(program, {}).get(what)
    if program == "lifecycle" and result != "'ERROR'":
        ours = None
    if ours is not None:
        return f"{what}: {ours}"
    return _named_types(line) if program == "parameters" else line


@pytest.mark.parametrize(
    "program", sorted(each.stem for each in PROGRAMS.glob("*.py") if each.name != SHARED)
)
def test_a_program_prints_the_same_as_in_ros(ros_python, program):
    path = PROGRAMS / f"{program}.py"
    there, _ = output([ros_python], path)
    here, _ = output([sys.executable, "-m", "taskrpc", "run"], path)
    assert len(there) > 20
    assert here == [expected_line(program, line) for line in there]
    if program in DIFFERENT:
        assert here != there  # else the table above has entries that nothing needs
