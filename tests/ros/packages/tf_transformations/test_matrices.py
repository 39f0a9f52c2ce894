"""Matrices: each one gives back what it was made from. The cases are those of the original."""

import math

import numpy as np
import pytest

from taskrpc.ros.packages import tf_transformations as tf

RANDOM = np.random.default_rng(7)


def vector(size=3):
    return RANDOM.random(size) - 0.5


def test_identity_and_translation():
    assert np.array_equal(tf.identity_matrix(), np.identity(4))
    moved = vector()
    assert np.allclose(tf.translation_matrix(moved)[:3, 3], moved)
    assert np.allclose(tf.translation_from_matrix(tf.translation_matrix(moved)), moved)


def test_reflection():
    point, normal = vector(4), vector()
    point[3] = 1
    matrix = tf.reflection_matrix(point, normal)
    assert np.trace(matrix) == pytest.approx(2)
    assert np.allclose(matrix @ point, point)
    assert tf.is_same_transform(matrix, tf.reflection_matrix(*tf.reflection_from_matrix(matrix)))


@pytest.mark.parametrize("direction", [None, (1.0, 2.0, 3.0)])
def test_scaling(direction):
    matrix = tf.scale_matrix(-1.234, vector(), direction)
    assert tf.is_same_transform(matrix, tf.scale_matrix(*tf.scale_from_matrix(matrix)))


def test_shearing():
    direction = vector()
    normal = np.cross(direction, vector())
    matrix = tf.shear_matrix(0.7, direction, vector(), normal)
    assert np.linalg.det(matrix) == pytest.approx(1)
    angle, *rest = tf.shear_from_matrix(matrix)
    assert tf.is_same_transform(matrix, tf.shear_matrix(angle, *rest))


def test_parts_of_a_matrix_are_found():
    rotation = tf.random_rotation_matrix((0.1, 0.2, 0.3))
    shear = tf.shear_matrix(-1.234, (1, 0, 0), (0, 0, 0), (0, 0, 1))
    matrix = tf.concatenate_matrices(
        tf.translation_matrix((1, 2, 3)), rotation, shear, tf.scale_matrix(1.23, (0, 0, 0))
    )
    scales, shears, angles, moved, perspective = tf.decompose_matrix(matrix)
    assert np.allclose(scales, 1.23)
    assert np.allclose(moved, (1, 2, 3))
    assert np.allclose(shears, (0, math.tan(-1.234), 0))
    assert tf.is_same_transform(rotation, tf.euler_matrix(*angles))
    assert perspective is None
    assert tf.is_same_transform(matrix, tf.compose_matrix(scales, shears, angles, moved))
    assert np.allclose(tf.compose_matrix(), np.identity(4))


def test_orthogonalization_has_the_documented_numbers():
    matrix = tf.orthogonalization_matrix((10.0, 10.0, 10.0), (90.0, 90.0, 90.0))
    assert np.allclose(matrix[:3, :3], np.identity(3) * 10)
    matrix = tf.orthogonalization_matrix([9.8, 12.0, 15.5], [87.2, 80.7, 69.7])
    assert np.sum(matrix) == pytest.approx(43.063229)


def test_clipping_maps_the_bounds_to_1():
    bounds = (1.0, 3.0, 2.0, 5.0, 0.5, 4.0)
    lowest, highest = [*bounds[::2], 1.0], [*bounds[1::2], 1.0]
    matrix = tf.clip_matrix(*bounds)
    assert np.allclose(matrix @ lowest, [-1, -1, -1, 1])
    assert np.allclose(matrix @ highest, [1, 1, 1, 1])
    matrix = tf.clip_matrix(*bounds, perspective=True)
    for corner, shown in ((lowest, [-1, -1, -1, 1]), ([3.0, 5.0, 0.5, 1.0], [1, 1, -1, 1])):
        seen = matrix @ corner
        assert np.allclose(seen / seen[3], shown)
    with pytest.raises(ValueError, match="invalid frustrum"):
        tf.clip_matrix(3, 1, 0, 1, 0, 1)
    with pytest.raises(ValueError, match="near <= 0"):
        tf.clip_matrix(0, 1, 0, 1, 0, 1, perspective=True)


@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"direction": (1, 2, 4)},
        {"perspective": (3, 1, 2)},
        {"perspective": (3, 1, 2), "pseudo": 1},
    ],
)
def test_projection_gives_its_arguments_back(kind):
    matrix = tf.projection_matrix((0.1, 0.2, 0.3), (1, 0.5, -2), **kind)
    found = tf.projection_from_matrix(matrix, pseudo=bool(kind.get("pseudo")))
    assert tf.is_same_transform(matrix, tf.projection_matrix(*found))


def test_projection_has_the_documented_numbers():
    matrix = tf.projection_matrix((0, 0, 0), (1, 0, 0))
    assert np.allclose(matrix[1:, 1:], np.identity(4)[1:, 1:])
    matrix = tf.projection_matrix((3, 0, 0), (1, 1, 0), (1, 0, 0))
    points = (RANDOM.random((4, 5)) - 0.5) * 20
    points[3] = 1
    shown = matrix @ points
    assert np.allclose(shown[1], points[1])
    assert np.allclose(shown[0], 3 - shown[1])
    point, normal, eye = vector(), vector(), vector()
    exact = tf.projection_matrix(point, normal, perspective=eye)
    pseudo = tf.projection_matrix(point, normal, perspective=eye, pseudo=True)
    assert tf.is_same_transform(exact, tf.projection_matrix(point, normal) @ pseudo)
    with pytest.raises(ValueError, match="no eigenvector corresponding to eigenvalue 0"):
        tf.projection_from_matrix(np.identity(4))


@pytest.mark.parametrize("usesvd", [True, False])
@pytest.mark.parametrize("scale", [1.0, 0.4])
def test_superimposition_finds_the_motion(usesvd, scale):
    points = (RANDOM.random((4, 100)) - 0.5) * 20
    points[3] = 1
    motion = tf.concatenate_matrices(
        tf.translation_matrix(vector()),
        tf.random_rotation_matrix((0.3, 0.6, 0.9)),
        tf.scale_matrix(scale),
    )
    found = tf.superimposition_matrix(points, motion @ points, scale != 1, usesvd)
    assert np.allclose(found, motion)
    with pytest.raises(ValueError, match="wrong shape"):
        tf.superimposition_matrix(points[:, :2], points[:, :2])
