"""The function that programs import from turtle_tf2_broadcaster, and the frame that it sends."""

import importlib
import math
from types import SimpleNamespace

import pytest

HALF = math.sqrt(0.5)


@pytest.fixture
def module(ros_names):
    return importlib.import_module("turtle_tf2_py.turtle_tf2_broadcaster")


def test_quaternion_is_an_array_with_w_last(module):
    found = module.quaternion_from_euler(0, 0, math.pi / 2)
    assert found.shape == (4,)
    assert list(found) == pytest.approx([0, 0, HALF, HALF])
    assert list(module.quaternion_from_euler(math.pi, 0.0, 0.0)) == pytest.approx([1, 0, 0, 0])


def test_frame_of_a_turtle_has_its_name_and_pose(module):
    found = module.frame_of("turtle2", SimpleNamespace(x=1.0, y=2.0, theta=-math.pi / 2))
    assert (found.header.frame_id, found.child_frame_id) == ("world", "turtle2")
    moved, turned = found.transform.translation, found.transform.rotation
    assert (moved.x, moved.y, moved.z) == (1, 2, 0)
    assert (turned.x, turned.y, turned.z, turned.w) == pytest.approx((0, 0, -HALF, HALF))
