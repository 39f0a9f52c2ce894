"""Matrices: each one gives back what it was made from. The cases are those of the original."""

import numpy as np

from taskrpc.ros.packages import tf_transformations as tf


def test_identity_and_translation():
    assert np.array_equal(tf.identity_matrix(), np.identity(4))
    moved = tf.translation_matrix((1, 2, 3))
    assert np.allclose(moved[:3, 3], (1, 2, 3))
    assert np.allclose(tf.translation_from_matrix(moved), (1, 2, 3))


def test_parts_of_a_matrix_are_found():
    rotation = tf.random_rotation_matrix((0.1, 0.2, 0.3))
    shear, scale = np.identity(4), np.diag((1.23, 1.23, 1.23, 1))
    shear[0, 2] = -2.8
    matrix = tf.concatenate_matrices(tf.translation_matrix((1, 2, 3)), rotation, shear, scale)
    scales, shears, angles, moved, perspective = tf.decompose_matrix(matrix)
    assert np.allclose(scales, 1.23)
    assert np.allclose(moved, (1, 2, 3))
    assert np.allclose(shears, (0, -2.8, 0))
    assert tf.is_same_transform(rotation, tf.euler_matrix(*angles))
    assert perspective is None
    assert tf.is_same_transform(matrix, tf.compose_matrix(scales, shears, angles, moved))
    assert np.allclose(tf.compose_matrix(), np.identity(4))
