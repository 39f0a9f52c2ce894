"""Rotations and rigid transforms obey the laws of a group, and interpolation stays on the arc."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from taskrpc.ros.packages.tf2_py import geometry
from taskrpc.ros.packages.tf2_py.geometry import NO_ROTATION, Transform

number = st.floats(-100, 100).map(lambda value: round(value, 6))
vectors = st.tuples(number, number, number)
part = st.floats(-1, 1)


@st.composite
def quaternions(draw):
    q = draw(st.tuples(part, part, part, part))
    assume(math.hypot(*q) > 0.01)
    return geometry.normalized(q)


transforms = st.builds(Transform, vectors, quaternions())


def near(values, absolute=1e-8):
    return pytest.approx(tuple(values), abs=absolute, rel=1e-9)


def same_rotation(a, b):
    return abs(sum(x * y for x, y in zip(a, b, strict=True))) == pytest.approx(1, abs=1e-9)


def angle_between(a, b):
    return 2 * math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b, strict=True)))))


@given(transforms, transforms, vectors)
def test_composed_transform_applies_one_after_the_other(a, b, point):
    assert a.after(b).apply(point) == near(a.apply(b.apply(point)))


@given(transforms, transforms, transforms, vectors)
def test_composition_is_associative(a, b, c, point):
    assert a.after(b).after(c).apply(point) == near(a.after(b.after(c)).apply(point))


@given(transforms, vectors)
def test_inverse_undoes_a_transform(transform, point):
    assert transform.inverse().apply(transform.apply(point)) == near(point)
    assert transform.after(transform.inverse()).apply(point) == near(point)


@given(quaternions(), vectors)
def test_rotation_keeps_lengths_and_agrees_with_its_matrix(q, v):
    rotated = geometry.rotate(q, v)
    assert math.hypot(*rotated) == pytest.approx(math.hypot(*v), abs=1e-8)
    rows = geometry.matrix_of_quaternion(q)
    assert rotated == near(sum(a * b for a, b in zip(row, v, strict=True)) for row in rows)


@given(quaternions(), quaternions(), st.floats(0, 1))
def test_interpolation_stays_on_the_shorter_arc(a, b, ratio):
    between = geometry.slerp(a, b, ratio)
    assert math.hypot(*between) == pytest.approx(1, abs=1e-6)
    whole = angle_between(a, b)
    assert angle_between(a, between) == pytest.approx(ratio * whole, abs=1e-5)
    assert angle_between(between, b) == pytest.approx((1 - ratio) * whole, abs=1e-5)


@given(transforms, transforms)
def test_interpolation_begins_and_ends_with_its_neighbours(a, b):
    assert a.toward(b, 0).translation == near(a.translation)
    assert a.toward(b, 1).translation == near(b.translation)
    assert same_rotation(a.toward(b, 0).rotation, a.rotation)
    assert same_rotation(a.toward(b, 1).rotation, b.rotation)


@given(quaternions())
def test_angles_give_the_quaternion_back(q):
    roll, pitch, yaw = geometry.angles_of_quaternion(q)
    assert abs(pitch) <= math.pi / 2
    if abs(pitch) < 1.57:
        assert same_rotation(geometry.quaternion_of_angles(roll, pitch, yaw), q)


def test_angles_of_known_rotations():
    half = math.sqrt(0.5)
    assert geometry.quaternion_of_angles(0, 0, math.pi / 2) == near((0, 0, half, half))
    assert geometry.quaternion_of_angles(1, 2, 3) == near(
        (-0.7182870182434115, 0.3106224510657039, 0.44443511344300074, 0.4359528440735657)
    )
    assert geometry.angles_of_quaternion((0, half, 0, half)) == near((0, math.pi / 2, 0), 1e-7)
    assert str(geometry.angles_of_quaternion(NO_ROTATION)) == "(0.0, -0.0, 0.0)"  # as in tf2


@pytest.mark.parametrize("length", [1e-200, 1e200])
def test_quaternion_of_extreme_length_is_normalised(length):
    assert geometry.normalized((0.0, 0.0, length, 0.0)) == (0.0, 0.0, 1.0, 0.0)


@given(quaternions(), st.floats(0.1, 10))
def test_normalized_quaternion_has_length_1_and_one_sign(q, length):
    longer = tuple(length * each for each in q)
    opposite = tuple(-each for each in longer)
    assert math.hypot(*geometry.normalized(longer)) == pytest.approx(1)
    assert geometry.normalized(longer) == near(q)
    assert geometry.normalized(opposite) == near(q)
    assert same_rotation(q, longer) or length != 1


def test_quaternion_of_length_0_is_no_rotation():
    assert all(map(math.isnan, geometry.normalized((0, 0, 0, 0))))
