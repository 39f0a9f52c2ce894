"""Vectors, and what all matrices have in common."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

EPSILON = float(np.finfo(float).eps) * 4
"""Smaller numbers count as 0."""


def numbers(values: Any) -> Any:
    """A new array of floats."""
    return np.array(values, dtype=np.float64)


def vector_norm(data: Any, axis: int | None = None, out: Any = None) -> Any:
    """The length of a vector, or the lengths of vectors along an axis (into `out`, if given)."""
    squares = np.square(numbers(data))
    if out is not None:
        np.sqrt(np.sum(squares, axis=axis), out=out)
        return None
    if squares.ndim == 1:
        return math.sqrt(np.sum(squares))
    return np.atleast_1d(np.sqrt(np.sum(squares, axis=axis)))


def unit_vector(data: Any, axis: int | None = None, out: Any = None) -> Any:
    """A vector with length 1, or several along an axis (into `out`, if given)."""
    values = numbers(data)
    lengths = np.sqrt(np.sum(np.square(values), axis=axis, keepdims=axis is not None))
    if values.size:
        values = values / lengths
    if out is None:
        return values
    out[...] = values
    return None


def random_vector(size: Any) -> Any:
    """Random numbers from 0 to below 1."""
    return np.random.random(size)


def inverse_matrix(matrix: Any) -> Any:
    """The inverse of a square matrix."""
    return np.linalg.inv(matrix)


def concatenate_matrices(*matrices: Any) -> Any:
    """The product of the matrices: the last one is applied first."""
    product = np.identity(4)
    for matrix in matrices:
        product = product @ np.asarray(matrix)
    return product


def is_same_transform(matrix0: Any, matrix1: Any) -> bool:
    """Whether two matrices transform points alike."""
    first, second = numbers(matrix0), numbers(matrix1)
    return bool(np.allclose(first / first[3, 3], second / second[3, 3]))
