"""Matrices that move points, and the parts of any matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from transforms3d import affines, euler

from .rotations import euler_from_matrix
from .vectors import numbers


def identity_matrix() -> Any:
    """The matrix that changes nothing."""
    return np.identity(4)


def translation_matrix(direction: Any) -> Any:
    """The matrix that moves by a vector."""
    matrix = np.identity(4)
    matrix[:3, 3] = direction[:3]
    return matrix


def translation_from_matrix(matrix: Any) -> Any:
    """The vector by which a matrix moves."""
    return numbers(matrix)[:3, 3]


def decompose_matrix(matrix: Any) -> Any:
    """Scale, shear, angles and translation of a matrix, and None for its perspective."""
    translation, rotation, scale, shear = affines.decompose(matrix)
    return scale, shear, euler_from_matrix(rotation), translation, None


def compose_matrix(
    scale: Any = None,
    shear: Any = None,
    angles: Any = None,
    translate: Any = None,
    perspective: Any = None,
) -> Any:
    """The matrix with these parts; as in ROS 2, `perspective` has no effect."""
    return affines.compose(
        [0.0, 0.0, 0.0] if translate is None else translate,
        np.identity(3) if angles is None else euler.euler2mat(*angles),
        [1.0, 1.0, 1.0] if scale is None else scale,
        [0.0, 0.0, 0.0] if shear is None else shear,
    )
