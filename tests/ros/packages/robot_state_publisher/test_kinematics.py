"""The transforms of a robot's joints are those of textbook kinematics with matrices."""

import importlib
import math
import random

import pytest

ARM = """
<robot name="arm">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <link name="e"/><link name="f"/><link name="g"/>
  <joint name="lift" type="prismatic">
    <parent link="base"/><child link="a"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/><axis xyz="1 2 -2"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="a"/><child link="b"/>
    <origin xyz="1 0 0.5" rpy="-1.1 0.2 3.0"/><axis xyz="0 3 4"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="continuous">
    <parent link="b"/><child link="c"/><origin xyz="0 0.7 0"/>
  </joint>
  <joint name="finger" type="prismatic">
    <parent link="c"/><child link="d"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/>
    <mimic joint="lift" multiplier="-2" offset="0.25"/>
  </joint>
  <joint name="camera" type="fixed">
    <parent link="c"/><child link="e"/><origin xyz="0 0 0.1" rpy="0 1.5 -3.1"/>
  </joint>
  <joint name="slide" type="planar"><parent link="c"/><child link="f"/></joint>
  <joint name="free" type="floating"><parent link="c"/><child link="g"/></joint>
</robot>
"""
ORIGINS = {
    "lift": ((0.1, -0.2, 0.3), (0.4, -0.5, 0.6)),
    "shoulder": ((1, 0, 0.5), (-1.1, 0.2, 3.0)),
    "wrist": ((0, 0.7, 0), (0, 0, 0)),
    "finger": ((0, 0, 0), (0, 0, 0)),
    "camera": ((0, 0, 0.1), (0, 1.5, -3.1)),
}
AXES = {"lift": (1 / 3, 2 / 3, -2 / 3), "shoulder": (0, 0.6, 0.8), "wrist": (1, 0, 0)}


@pytest.fixture
def kinematics(ros_names):
    return importlib.import_module("robot_state_publisher.kinematics")


@pytest.fixture
def robot(ros_names):
    return importlib.import_module("robot_state_publisher.urdf").parse(ARM)


# Matrices of 4 x 4, without any function of taskrpc


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def translation(x, y, z):
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


def turn(axis, angle):
    """Rodrigues' rotation formula."""
    x, y, z = axis
    c, s, v = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
    return [
        [c + x * x * v, x * y * v - z * s, x * z * v + y * s, 0],
        [y * x * v + z * s, c + y * y * v, y * z * v - x * s, 0],
        [z * x * v - y * s, z * y * v + x * s, c + z * z * v, 0],
        [0, 0, 0, 1],
    ]


def origin(name):
    xyz, (roll, pitch, yaw) = ORIGINS[name]
    made = translation(*xyz)
    for axis, angle in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll)):
        made = product(made, turn(axis, angle))
    return made


def matrix(transform):
    """The matrix of a transform with a quaternion."""
    x, y, z, w = transform.rotation
    assert math.hypot(x, y, z, w) == pytest.approx(1)
    a, b, c = transform.translation
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), a],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), b],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), c],
        [0, 0, 0, 1],
    ]


def expected(name, position):
    if name == "finger":
        return product(origin(name), translation(position, 0, 0))
    if name == "lift":
        return product(origin(name), translation(*(each * position for each in AXES[name])))
    return product(origin(name), turn(AXES[name], position))


def assert_same(found, wanted):
    assert [pytest.approx(row, abs=1e-12) for row in wanted] == found


def test_moving_frames_are_where_matrices_place_them(kinematics, robot):
    numbers = random.Random(1)
    for _ in range(50):
        positions = {name: numbers.uniform(-4, 4) for name in ("lift", "shoulder", "wrist")}
        frames = {each.child: each for each in kinematics.moving_frames(robot, positions)}
        assert {child: each.parent for child, each in frames.items()} == {
            "a": "base",
            "b": "a",
            "c": "b",
            "d": "c",
        }
        positions["finger"] = -2 * positions["lift"] + 0.25  # it mimics the lift
        for name, child in (("lift", "a"), ("shoulder", "b"), ("wrist", "c"), ("finger", "d")):
            assert_same(matrix(frames[child].transform), expected(name, positions[name]))
        chain = frames["a"].transform.after(frames["b"].transform).after(frames["c"].transform)
        wanted = product(
            product(
                expected("lift", positions["lift"]), expected("shoulder", positions["shoulder"])
            ),
            expected("wrist", positions["wrist"]),
        )
        assert_same(matrix(chain), wanted)


def test_only_joints_with_a_position_move(kinematics, robot):
    frames = kinematics.moving_frames(robot, {"wrist": 0.5, "camera": 1.0, "nobody": 2.0})
    assert [each.child for each in frames] == ["c"]
    own = kinematics.moving_frames(robot, {"lift": 1.0, "finger": 0.5})
    assert next(each for each in own if each.child == "d").transform.translation == (0.5, 0, 0)


def test_fixed_and_planar_joints_are_static_and_floating_ones_are_left_out(kinematics, robot):
    camera, slide = kinematics.fixed_frames(robot)
    assert (camera.parent, camera.child, slide.child) == ("c", "e", "f")
    assert_same(matrix(camera.transform), origin("camera"))
    assert max(camera.transform.rotation, key=abs) > 0  # of two quaternions, that of tf2 and KDL
    assert slide.transform == ((0, 0, 0), (0, 0, 0, 1))


def test_pace_uses_so_many_messages_a_second_for_each_joint(kinematics):
    pace = kinematics.Pace(20.0)
    second = 10**9
    used = []
    for stamp in range(100 * second, 101 * second, second // 100):  # 100 a second
        assert not pace.went_back(stamp)
        if pace.is_due(["a"], stamp):
            pace.used(["a"], stamp)
            used.append(stamp)
    assert len(used) == 20
    assert pace.is_due(["a", "b"], used[-1] + 1)  # b is new
    assert not pace.is_due(["a"], used[-1] + 1)
    assert not pace.is_due(["b"], 0)  # without a stamp


def test_after_a_step_back_in_time_every_joint_is_new(kinematics):
    pace = kinematics.Pace(1.0)
    assert not pace.went_back(50 * 10**9)
    pace.used(["a"], 50 * 10**9)
    assert pace.went_back(20 * 10**9)
    assert pace.is_due(["a"], 20 * 10**9)
