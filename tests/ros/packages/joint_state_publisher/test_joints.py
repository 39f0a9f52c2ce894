"""The states of joints: first positions, limits, sources, motion, and joints that follow others."""

import importlib
import math

import pytest

ROBOT = """
<robot name="r">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <link name="e"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="a"/></joint>
  <joint name="high" type="prismatic">
    <parent link="a"/><child link="b"/><limit lower="1" upper="2" effort="1" velocity="1"/>
    <safety_controller soft_lower_limit="1.4" soft_upper_limit="3" k_velocity="1"/>
  </joint>
  <joint name="twin" type="prismatic">
    <parent link="a"/><child link="c"/><limit lower="0" upper="9" effort="1" velocity="1"/>
    <mimic joint="high" multiplier="2" offset="0.5"/>
  </joint>
  <joint name="third" type="prismatic">
    <parent link="a"/><child link="d"/><limit lower="0" upper="9" effort="1" velocity="1"/>
    <mimic joint="twin" multiplier="-1" offset="4"/>
  </joint>
  <joint name="screw" type="fixed"><parent link="a"/><child link="e"/></joint>
</robot>
"""


@pytest.fixture
def module(ros_names):
    return importlib.import_module("joint_state_publisher.joints")


@pytest.fixture
def make(module):
    parse = importlib.import_module("robot_state_publisher.urdf").parse

    def make(text=ROBOT, **settings):
        return module.Joints(parse(text), module.Settings(**settings))

    return make


def test_a_joint_begins_at_0_or_in_the_middle_of_its_limits(make):
    states = make().states()
    assert states.names == ["turn", "high", "twin", "third"]
    high = (1.4 + 2) / 2  # the smallest limits
    assert states.positions == pytest.approx([0, high, 2 * high + 0.5, 4 - (2 * high + 0.5)])
    assert (states.velocities, states.efforts) == ([], [])
    assert make(use_smallest_joint_limits=False).states().positions[1] == 1.5


def test_parameters_choose_the_first_values(make):
    states = make(
        zeros={"high": 1.75}, publish_default_velocities=True, publish_default_efforts=True
    ).states()
    assert states.positions == [0, 1.75, 4, 0]
    assert states.velocities == states.efforts == [0, 0, 0, 0]
    assert make(publish_default_positions=False).states().positions == []


def test_messages_of_sources_change_only_joints_that_follow_no_other(make):
    joints = make()
    joints.take(["high", "twin", "nobody"], [1.5, 7.0, 7.0], [0.25, 7.0, 7.0], [3.0, 7.0, 7.0])
    states = joints.states()
    assert states.positions == [0, 1.5, 3.5, 0.5]
    assert states.velocities == [0, 0.25, 0.5, -0.5]
    assert states.efforts == [0, 3, 3, 3]
    joints.take(["high"], [], [0.5], [])
    assert joints.states().positions[1] == 1.5
    assert joints.states().velocities[1] == 0.5


def test_a_joint_moves_between_its_limits_and_a_continuous_one_begins_anew(make):
    joints = make(zeros={"high": 1.5}, use_smallest_joint_limits=False)
    found = []
    for _ in range(9):
        joints.move(0.3)
        found.append(round(joints.free["high"].position, 3))
    assert found == [1.8, 2.0, 1.7, 1.4, 1.1, 1.0, 1.3, 1.6, 1.9]
    joints.move(10.0)
    assert joints.free["turn"].position == -math.pi


def test_without_mimic_tags_and_with_dependent_joints(module, make):
    assert make(use_mimic_tags=False).states().positions[2] == 0
    followed = module.Mimic("high", -1.0, 0.25)
    states = make(zeros={"high": 1.5}, dependent_joints={"turn": followed}).states()
    assert states.positions[0] == -1.25


def test_a_chain_that_never_ends_is_refused(module, make):
    problem = "infinite recursive mimic chain"
    circle = {"high": module.Mimic("turn"), "turn": module.Mimic("high")}
    with pytest.raises(ValueError, match=problem):
        make(dependent_joints=circle)
    with pytest.raises(ValueError, match="joint 'turn' follows the joint 'gone', which is not"):
        make(dependent_joints={"turn": module.Mimic("gone")})
