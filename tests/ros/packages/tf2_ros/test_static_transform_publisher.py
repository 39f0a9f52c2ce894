"""The command line of static_transform_publisher: both styles, and ROS's errors."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.properties import examples

HALF = math.sqrt(0.5)


@pytest.fixture
def parse(ros):
    parse = ros.module("tf2_ros.static_transform_publisher").parse
    return lambda line: parse(line.split())


def near(values):
    return pytest.approx(values)


def test_flags_name_the_values(parse):
    found = parse("--x 1 --z -2.5 --yaw 1.5707963267948966 --frame-id world --child-frame-id robot")
    assert found == (near((1, 0, -2.5)), near((0, 0, HALF, HALF)), "world", "robot", False)
    found = parse("--qz 1 --qw 0 --frame-id a --child-frame-id b")
    assert found[:2] == ((0, 0, 0), (0, 0, 1, 0))
    assert parse("--frame-id a --child-frame-id b")[1] == (0, 0, 0, 1)
    assert parse("--qx 0 --frame-id a --child-frame-id b")[1] == (0, 0, 0, 1)


def test_old_style_has_yaw_before_roll_or_a_quaternion(parse):
    found = parse("1 2 3 1.5707963267948966 0 0 world robot")
    assert found == ((1, 2, 3), near((0, 0, HALF, HALF)), "world", "robot", True)
    assert parse("0 0 0 0 0 1 0 world robot")[1] == (0, 0, 1, 0)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("", "Not enough arguments to parse"),
        ("--x", "Not enough arguments for --x"),
        ("--x far --frame-id a --child-frame-id b", "Failed to parse --x argument as float"),
        ("1 2 z 0 0 0 a b", "Failed to parse z argument as float"),
        ("1 2 3", "Extra unparsed arguments on command-line: 1 2 3"),
        ("--x 1 --child-frame-id b", "Frame id must not be empty"),
        ("--x 1 --frame-id a", "Child frame id must not be empty"),
        (
            "--qx 1 --yaw 1 --frame-id a --child-frame-id b",
            "Cannot specify both quaternion and Euler rotations",
        ),
        (
            "1 2 3 0 0 0 a b --x 1",
            "Cannot specify both new-style (flags) and old-style (arguments)",
        ),
    ],
)
def test_wrong_lines_have_the_errors_of_ros(parse, line, text):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the text is compared below
        parse(line)
    assert str(caught.value) == text


words = st.sampled_from("--x --qw --yaw --frame-id --child-frame-id -h 1 nan far a".split())


@settings(max_examples=examples(50), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(words, max_size=10))
def test_any_line_gives_a_transform_or_one_line_of_explanation(parse, line):
    try:
        found = parse(" ".join(line))
    except ValueError as error:
        found = str(error)
        assert "\n" not in found
    assert found or "-h" in line


def test_program_prints_usage_and_errors(ros, capfd):
    main = ros.module("tf2_ros.static_transform_publisher").main
    assert main(["publisher", "--help"]) is None
    assert capfd.readouterr().out.startswith("usage: static_transform_publisher [--x X]")
    with pytest.raises(SystemExit) as ended:
        main(["publisher", "1"])
    assert ended.value.code == 1
    out, err = capfd.readouterr()
    assert out.startswith("usage: static_transform_publisher")
    assert "[]: error parsing command line arguments: Extra unparsed arguments on" in err
    with pytest.raises(SystemExit, match="child_frame_id cannot equal frame_id"):
        main("publisher --frame-id a --child-frame-id a".split())
