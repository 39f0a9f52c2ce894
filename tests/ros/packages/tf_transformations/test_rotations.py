"""Rotations: the documented numbers of the original, and laws that hold for all rotations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.ros.packages import tf_transformations as tf
from taskrpc.ros.packages.tf2_py import geometry

AXES = [
    frame + order
    for frame in "sr"
    for order in "xyz xyx xzy xzx yzx yzy yxz yxy zxy zxz zyx zyz".split()
]
angle = st.floats(-3, 3)
angles = st.tuples(angle, angle, angle)
quaternions = angles.map(lambda values: tf.quaternion_from_euler(*values))


def same(a, b):
    return np.allclose(a, b) or np.allclose(a, -np.asarray(b))


@pytest.mark.parametrize(
    ("found", "documented"),
    [
        (tf.quaternion_from_euler(1, 2, 3, "ryxz"), [0.310622, -0.718287, 0.444435, 0.435953]),
        (tf.quaternion_from_euler(0, 0, math.pi / 2), [0, 0, 0.70710678, 0.70710678]),
        (tf.euler_from_quaternion([0.06146124, 0, 0, 0.99810947]), [0.123, 0, 0]),
        (tf.quaternion_about_axis(0.123, (1, 0, 0)), [0.06146124, 0, 0, 0.99810947]),
        (tf.quaternion_about_axis(0.123, (5, 0, 0)), [0.06146124, 0, 0, 0.99810947]),
        (tf.quaternion_multiply([1, -2, 3, 4], [-5, 6, 7, 8]), [-44, -14, 48, 28]),
        (
            tf.quaternion_from_matrix(tf.rotation_matrix(0.123, (1, 2, 3))),
            [0.0164262, 0.0328524, 0.0492786, 0.9981095],
        ),
        (
            tf.quaternion_matrix([0.06146124, 0, 0, 0.99810947]),
            tf.rotation_matrix(0.123, (1, 0, 0)),
        ),
        (np.sum(tf.euler_matrix(1, 2, 3, "syxz")[0]), -1.34786452),
        (np.sum(tf.euler_matrix(1, 2, 3, (0, 1, 0, 1))[0]), -0.383436184),
        (tf.rotation_matrix(2 * math.pi, (1, 2, 3)), np.identity(4)),
        (np.trace(tf.rotation_matrix(math.pi / 2, (1, 2, 3), (4, 5, 6))), 2),
    ],
)
def test_documented_numbers(found, documented):
    assert np.allclose(found, documented)


@given(angles)
def test_quaternion_agrees_with_tf2(values):
    assert same(tf.quaternion_from_euler(*values), geometry.quaternion_of_angles(*values))


@settings(max_examples=25)
@given(angles, st.sampled_from(AXES))
def test_euler_angles_give_their_matrix_back(values, axes):
    matrix = tf.euler_matrix(*values, axes)
    assert np.allclose(tf.euler_matrix(*tf.euler_from_matrix(matrix, axes), axes), matrix)
    assert np.allclose(tf.quaternion_matrix(tf.quaternion_from_euler(*values, axes)), matrix)


@settings(max_examples=25)
@given(quaternions, quaternions)
def test_product_of_quaternions_is_the_product_of_matrices(a, b):
    product = tf.quaternion_matrix(tf.quaternion_multiply(a, b))
    assert np.allclose(product, tf.quaternion_matrix(a) @ tf.quaternion_matrix(b))
    assert same(tf.quaternion_multiply(a, tf.quaternion_inverse(a)), [0, 0, 0, 1])
    assert np.allclose(tf.quaternion_conjugate(a)[:3], -np.asarray(a[:3]))


@settings(max_examples=25)
@given(quaternions, quaternions, st.floats(0, 1))
def test_slerp_agrees_with_tf2(a, b, fraction):
    found = tf.quaternion_slerp(a, b, fraction)
    assert np.linalg.norm(found) == pytest.approx(1)
    expected = geometry.slerp(tuple(a), tuple(b), fraction)
    assert abs(np.dot(found, expected)) == pytest.approx(1, abs=1e-9)


def test_slerp_takes_the_longer_arc_and_spins_if_told():
    a, b = tf.quaternion_from_euler(0, 0, 0), tf.quaternion_from_euler(0, 0, 1.0)
    opposite = tuple(-each for each in b)
    longer = tf.quaternion_slerp(a, opposite, 0.5, shortestpath=False)
    assert tf.euler_from_quaternion(longer)[2] == pytest.approx(0.5 - math.pi)
    assert np.allclose(tf.quaternion_slerp(a, b, 1.0, 1), b)
    assert np.allclose(tf.quaternion_slerp(a, a, 0.3), a)


def test_axis_of_a_rotation_matrix_is_found():
    first = tf.rotation_matrix(0.5, (1, 2, 3), (4, 5, 6))
    assert tf.is_same_transform(first, tf.rotation_matrix(*tf.rotation_from_matrix(first)))
    assert tf.is_same_transform(first, tf.rotation_matrix(-0.5, (-1, -2, -3), (4, 5, 6)))


@given(st.tuples(*[st.floats(0, 1)] * 3))
def test_random_quaternions_have_length_1(rand):
    assert np.linalg.norm(tf.random_quaternion(rand)) == pytest.approx(1)
    matrix = tf.random_rotation_matrix(rand)
    assert np.allclose(matrix.T @ matrix, np.identity(4))


def test_random_quaternions_differ():
    assert tf.random_quaternion().shape == (4,)
    assert not np.allclose(tf.random_rotation_matrix(), tf.random_rotation_matrix())
