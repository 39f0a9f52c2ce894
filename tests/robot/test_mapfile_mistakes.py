"""Mistakes in a map are shown at their line, whatever the text."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import taskrpc.robot
from taskrpc.robot import MapError, parse_map

PROBLEMS = {
    "empty": ("", "m.yaml: error: the map is empty"),
    "only a comment": ("# nothing\n", "m.yaml: error: the map is empty"),
    "a list": (
        "- size\n",
        """m.yaml:1:1: error: a map: expected entries as `name: value`, got a list of 1
    - size
    ^""",
    ),
    "not YAML": (
        "size: [8, 6\ndock: [1, 1]\n",
        """m.yaml:2:5: error: not valid YAML: expected ',' or ']', but got ':'
    dock: [1, 1]
        ^""",
    ),
    "a tab": (
        "size: [8, 6]\nplaces:\n\ta: [1, 1]\ndock: [1, 1]\n",
        """m.yaml:3:1: error: not valid YAML: found character '\\t' that cannot start any token
    \ta: [1, 1]
    ^""",
    ),
    "two documents": (
        "size: [8, 6]\n---\ndock: [1, 1]\n",
        """m.yaml:2:1: error: not valid YAML: but found another document
    ---
    ^""",
    ),
    "a control character": (
        "size: [8, 6]\ndock: [1, 1]\x07\n",
        """m.yaml:2:13: error: not valid YAML: the character '\\x07' is not allowed
    dock: [1, 1]\x07
                ^""",
    ),
    "an unknown key": (
        "size: [8, 6]\ndock: [1, 1]\nplases: {}\n",
        """m.yaml:3:1: error: a map has no 'plases' (did you mean 'places'?): expected size, dock, \
robot_radius, walls, boxes, places
    plases: {}
    ^""",
    ),
    "a key twice": (
        "size: [8, 6]\ndock: [1, 1]\nsize: [9, 6]\n",
        """m.yaml:3:1: error: a map: 'size' appears twice
    size: [9, 6]
    ^""",
    ),
    "a list as key": (
        "size: [8, 6]\n[1, 2]: 3\n",
        """m.yaml:2:1: error: a map: expected a name before the colon, got a list of 2
    [1, 2]: 3
    ^""",
    ),
    "no size": ("dock: [1, 1]\n", "m.yaml: error: a map needs 'size'"),
    "no dock": ("size: [8, 6]\n", "m.yaml: error: a map needs 'dock'"),
    "size is a word": (
        "size: big\ndock: [1, 1]\n",
        """m.yaml:1:7: error: size: expected [width, height] in metres, got 'big'
    size: big
          ^""",
    ),
    "size is missing a number": (
        "size: [8]\ndock: [1, 1]\n",
        """m.yaml:1:7: error: size: expected [width, height] in metres, got a list of 1
    size: [8]
          ^""",
    ),
    "size has nothing": (
        "size:\ndock: [1, 1]\n",
        """m.yaml:1:6: error: size: expected [width, height] in metres, got nothing
    size:
         ^""",
    ),
    "size is a quoted number": (
        "size: ['8', 6]\ndock: [1, 1]\n",
        """m.yaml:1:8: error: size: expected a number in metres, got '8'
    size: ['8', 6]
           ^""",
    ),
    "size is not finite": (
        "size: [inf, 6]\ndock: [1, 1]\n",
        """m.yaml:1:8: error: size: expected a number in metres, got 'inf'
    size: [inf, 6]
           ^""",
    ),
    "size is negative": (
        "size: [8, -6]\ndock: [1, 1]\n",
        """m.yaml:1:7: error: size: expected more than 0 and at most 1000 metres each way
    size: [8, -6]
          ^""",
    ),
    "a radius of nothing": (
        "size: [8, 6]\nrobot_radius: 0\ndock: [1, 1]\n",
        """m.yaml:2:15: error: robot_radius: expected more than 0 metres, got 0
    robot_radius: 0
                  ^""",
    ),
    "walls is one wall": (
        "size: [8, 6]\nwalls: [1, 1, 2, 2]\ndock: [1, 1]\n",
        """m.yaml:2:9: error: a wall: expected [x, y, x, y] in metres, got '1'
    walls: [1, 1, 2, 2]
            ^""",
    ),
    "walls is named": (
        "size: [8, 6]\nwalls: {a: 1}\ndock: [1, 1]\n",
        """m.yaml:2:8: error: walls: expected a list, got named entries
    walls: {a: 1}
           ^""",
    ),
    "a wall without length": (
        "size: [8, 6]\nwalls:\n  - [4, 3, 4, 3]\ndock: [1, 1]\n",
        """m.yaml:3:5: error: a wall: its two ends are the same point
      - [4, 3, 4, 3]
        ^""",
    ),
    "a wall outside": (
        "size: [8, 6]\nwalls:\n  - [4, 3, 4, 7]\ndock: [1, 1]\n",
        """m.yaml:3:5: error: a wall reaches to 4, 7, outside the map of 8 x 6 m
      - [4, 3, 4, 7]
        ^""",
    ),
    "a box without a size": (
        "size: [8, 6]\nboxes:\n  - at: [4, 3]\ndock: [1, 1]\n",
        """m.yaml:3:5: error: a box needs 'size'
      - at: [4, 3]
        ^""",
    ),
    "a box with a slip": (
        "size: [8, 6]\nboxes:\n  - {at: [4, 3], sise: [1, 1]}\ndock: [1, 1]\n",
        """m.yaml:3:18: error: a box has no 'sise' (did you mean 'size'?): expected at, size
      - {at: [4, 3], sise: [1, 1]}
                     ^""",
    ),
    "a flat box": (
        "size: [8, 6]\nboxes:\n  - {at: [4, 3], size: [1, 0]}\ndock: [1, 1]\n",
        """m.yaml:3:24: error: a box's size: expected more than 0 metres each way
      - {at: [4, 3], size: [1, 0]}
                           ^""",
    ),
    "a box outside": (
        "size: [8, 6]\nboxes:\n  - {at: [7, 3], size: [2, 1]}\ndock: [1, 1]\n",
        """m.yaml:3:5: error: a box reaches to 9, 4, outside the map of 8 x 6 m
      - {at: [7, 3], size: [2, 1]}
        ^""",
    ),
    "places is a list": (
        "size: [8, 6]\nplaces: [a, b]\ndock: [1, 1]\n",
        """m.yaml:2:9: error: places: expected entries as `name: value`, got a list of 2
    places: [a, b]
            ^""",
    ),
    "a place called dock": (
        "size: [8, 6]\nplaces:\n  dock: [2, 2]\ndock: [1, 1]\n",
        """m.yaml:3:3: error: a place cannot be named 'dock': the dock has this name
      dock: [2, 2]
      ^""",
    ),
    "a place with a space": (
        "size: [8, 6]\nplaces:\n  my place: [2, 2]\ndock: [1, 1]\n",
        """m.yaml:3:3: error: a place cannot be named 'my place': expected letters, digits, _ and \
-, beginning with a letter
      my place: [2, 2]
      ^""",
    ),
    "a place that looks like a point": (
        "size: [8, 6]\nplaces:\n  '1,2': [2, 2]\ndock: [1, 1]\n",
        """m.yaml:3:3: error: a place cannot be named '1,2': expected letters, digits, _ and -, \
beginning with a letter
      '1,2': [2, 2]
      ^""",
    ),
    "a place outside": (
        "size: [8, 6]\nplaces:\n  a: [9, 2]\ndock: [1, 1]\n",
        """m.yaml:3:6: error: a reaches to 9, 2, outside the map of 8 x 6 m
      a: [9, 2]
         ^""",
    ),
    "a place inside a wall": (
        "size: [8, 6]\nwalls:\n  - [4, 0, 4, 3]\nplaces:\n  a: [4.1, 2]\ndock: [1, 1]\n",
        """m.yaml:5:6: error: the robot cannot stand at 'a': a wall or box is nearer than its \
radius of 0.25 m
      a: [4.1, 2]
         ^""",
    ),
    "a place out of reach": (
        "size: [8, 6]\nwalls:\n  - [4, 0, 4, 6]\nplaces:\n  a: [6, 2]\ndock: [1, 1]\n",
        """m.yaml:5:6: error: no way leads from the dock to 'a': walls are in between, or a gap is \
too narrow for the robot
      a: [6, 2]
         ^""",
    ),
    "a dock at the outer wall": (
        "size: [8, 6]\ndock: [0.1, 1]\n",
        """m.yaml:2:7: error: the robot cannot stand at 'dock': a wall or box is nearer than its \
radius of 0.25 m
    dock: [0.1, 1]
          ^""",
    ),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_each_mistake_is_shown_at_its_line(name):
    text, message = PROBLEMS[name]
    with pytest.raises(MapError) as caught:
        parse_map(text, "m.yaml")
    assert str(caught.value) == message


def test_a_bottomless_file_is_an_error_and_no_crash():
    with pytest.raises(MapError, match="not valid YAML: nested too deeply"):
        parse_map("[" * 1_000)


@given(st.text(alphabet="size: [8, 6]\ndockplaeb{}-&*#'\"\t", max_size=60))
def test_any_text_is_a_map_or_a_map_error(text):
    try:
        parse_map("size: [8, 6]\ndock: [1, 1]\n" + text)
    except MapError as error:
        assert re.match(r"map(:\d+:\d+)?: error: ", str(error))  # noqa: PT017


@pytest.mark.real_time
def test_own_robot_class_needs_no_yaml():
    code = "import sys, taskrpc.robot; sys.exit('yaml' in sys.modules)"
    folder = Path(taskrpc.robot.__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=folder, check=False).returncode == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "size: [10, 8]\ndock: [1, 1]\nplaces:\nkitchen: [2, 2]",
            "if it belongs to 'places', indent",
        ),
        (
            "size: [10, 8]\n  dock: [1, 1]",
            "expected entries of one level to begin in the same column",
        ),
    ],
)
def test_error_names_wrong_indentation(text, message):
    with pytest.raises(MapError, match=message):
        parse_map(text)
