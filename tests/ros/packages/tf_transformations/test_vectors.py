"""Lengths, unit vectors and products. The cases are those of the original."""

import numpy as np
import pytest

from taskrpc.ros.packages import tf_transformations as tf


def test_length_of_a_vector_and_of_vectors_along_an_axis():
    values = np.arange(90.0).reshape(6, 5, 3) + 1
    assert tf.vector_norm([3, 4]) == 5
    assert (tf.vector_norm([]), tf.vector_norm([1.0])) == (0.0, 1.0)
    for axis in (-1, 0, 1):
        lengths = np.sqrt(np.sum(values * values, axis=axis))
        assert np.allclose(tf.vector_norm(values, axis=axis), lengths)
    out = np.empty((6, 3))
    tf.vector_norm(values, axis=1, out=out)
    assert np.allclose(out, tf.vector_norm(values, axis=1))


def test_unit_vectors_have_length_1():
    values = np.arange(60.0).reshape(5, 4, 3) + 1
    assert list(tf.unit_vector([])) == []
    assert list(tf.unit_vector([3.0, 4.0])) == pytest.approx([0.6, 0.8])
    for axis in (-1, 1):
        assert np.allclose(tf.vector_norm(tf.unit_vector(values, axis=axis), axis=axis), 1)
    out = np.empty_like(values)
    tf.unit_vector(values, axis=1, out=out)
    assert np.allclose(out, tf.unit_vector(values, axis=1))


def test_products_and_inverses():
    first, second = tf.euler_matrix(1, 2, 3), tf.translation_matrix((1, 2, 3))
    product = tf.concatenate_matrices(first, second)
    assert np.allclose(product, first @ second)
    assert tf.is_same_transform(product @ tf.inverse_matrix(product), np.identity(4) * 2)
    assert not tf.is_same_transform(first, second)
    assert tf.random_vector(10).shape == (10,)
