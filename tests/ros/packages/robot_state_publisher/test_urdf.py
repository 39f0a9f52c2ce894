"""Robot descriptions are read as ROS reads them, and mistakes are named with their line."""

import importlib

import pytest

LINKS = '<link name="base"/><link name="arm"/>'
JOINT = (
    '<joint name="j" type="{type}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'
)
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


@pytest.fixture
def urdf(ros_names):
    return importlib.import_module("robot_state_publisher.urdf")


def joint(type="fixed", parent="base", child="arm", more=""):
    return JOINT.format(type=type, parent=parent, child=child, more=more)


def robot(*joints, links=LINKS):
    return f'<robot name="r">\n{links}\n{"".join(joints)}\n</robot>'


def test_a_joint_has_its_origin_axis_limits_and_mimic(urdf):
    more = (
        '<origin xyz="1 2 3" rpy="0 0 0"/><axis xyz="0 3 4"/>'
        f'{LIMIT}<safety_controller soft_lower_limit="-0.5" k_velocity="1"/>'
        '<mimic joint="k" multiplier="2" offset="0.5"/>'
    )
    found = urdf.parse(f'\n<?xml version="1.0"?>{robot(joint("revolute", more=more))}')
    assert (found.name, found.links, found.root) == ("r", ("base", "arm"), "base")
    [made] = found.joints
    assert made.origin.translation == (1, 2, 3)
    assert made.axis == (0, 0.6, 0.8)
    assert (made.limits, made.soft_limits) == ((-1, 2), (-0.5, None))
    assert made.mimic == urdf.Mimic("k", 2, 0.5)


def test_what_a_joint_does_not_say_has_ros_defaults(urdf):
    [made] = urdf.parse(robot(joint("continuous"))).joints
    assert made.origin.translation == (0, 0, 0)
    assert made.origin.rotation == (0, 0, 0, 1)
    assert (made.axis, made.limits, made.mimic) == ((1, 0, 0), None, None)


def test_one_link_is_a_robot(urdf):
    assert urdf.parse('<robot><link name="base"/></robot>').root == "base"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "line 1: invalid XML: no element found"),
        ("<robot><link></robot>", "line 1: invalid XML: mismatched tag"),
        ("<model/>", "line 1: expected the element <robot>, got <model>"),
        ("<robot/>", "expected at least one <link name=.../>, got none"),
        ("<robot>\n<link/></robot>", "line 2: <link> needs the attribute 'name'"),
        (robot(joint("hinge")), "line 3: joint 'j' has the type 'hinge'; expected one of"),
        (robot(joint("revolute")), "line 3: the revolute joint 'j' needs a <limit .../>"),
        (
            robot(joint("revolute", more='<limit effort="1"/>')),
            "line 3: <limit> needs the attribute 'velocity'",
        ),
        (
            robot(joint(more='<origin xyz="1 2"/>')),
            "line 3: 'xyz' of <origin>: expected three numbers, got '1 2'",
        ),
        (
            robot(joint(more='<origin rpy="0 0 ${pi}"/>')),
            "line 3: 'rpy' of <origin>: expected a number, got '${pi}'",
        ),
        (
            robot(joint(more='<origin rpy="0 0 nan"/>')),
            "line 3: 'rpy' of <origin>: expected a number, got 'nan'",
        ),
        (robot(joint(more='<axis xyz="0 0 0"/>')), "expected the direction of an axis, got 0 0 0"),
        (robot('<joint name="j" type="fixed"/>'), "joint 'j' needs a <parent link=.../>"),
        (robot(joint(child="hand")), "child link 'hand' of joint 'j' not found: add <link name="),
        (robot(joint(), links=LINKS + LINKS), "link 'base' is not unique"),
        (robot(), "two root links found: 'base' and 'arm'; connect them with a joint"),
        (
            robot(joint(), joint().replace('"j"', '"k"')),
            "link 'arm' is the child of two joints: 'j', 'k'",
        ),
        (
            robot(joint(), joint(parent="arm", child="base").replace('"j"', '"k"')),
            "in a circle; expected a tree of links",
        ),
        (
            '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">]><robot name="&a;"/>',
            "line 1: a <!DOCTYPE ...> is not allowed",
        ),
        ("<a>" * 101, "at most 100 inside each other"),
        ("\ud800", "expected text that UTF-8 can encode"),
    ],
)
def test_a_mistake_is_one_line(urdf, text, problem):
    with pytest.raises(urdf.UrdfError) as caught:
        urdf.parse(text)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_size_is_limited(urdf, monkeypatch):
    monkeypatch.setattr(urdf, "_MOST_ELEMENTS", 2)
    with pytest.raises(urdf.UrdfError, match="line 2: expected at most 2 elements"):
        urdf.parse(robot(joint()))
    monkeypatch.setattr(urdf, "_MOST_CHARACTERS", 10)
    with pytest.raises(urdf.UrdfError, match="expected at most 10 characters, got"):
        urdf.parse(robot(joint()))
