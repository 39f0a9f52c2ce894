"""Matrices that move, scale, shear, mirror and project points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from transforms3d import affines, euler, reflections, shears, zooms

from .rotations import euler_from_matrix, quaternion_matrix
from .vectors import EPSILON, numbers, unit_vector


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


def reflection_matrix(point: Any, normal: Any) -> Any:
    """The matrix that mirrors at the plane through a point."""
    return reflections.rfnorm2aff(normal, point[:3])


def reflection_from_matrix(matrix: Any) -> Any:
    """Point and normal of the plane at which a matrix mirrors."""
    normal, point = reflections.aff2rfnorm(matrix)
    return point, normal


def scale_matrix(factor: float, origin: Any = None, direction: Any = None) -> Any:
    """The matrix that scales around an origin, in one direction or in all."""
    return zooms.zfdir2aff(factor, direction=direction, origin=origin)


def scale_from_matrix(matrix: Any) -> Any:
    """Factor, origin and direction of a matrix that scales."""
    factor, direction, origin = zooms.aff2zfdir(matrix)
    return factor, origin, direction


def shear_matrix(angle: float, direction: Any, point: Any, normal: Any) -> Any:
    """The matrix that shears by an angle, along a direction in the plane of point and normal."""
    return shears.sadn2aff(angle, direction, normal, point)


def shear_from_matrix(matrix: Any) -> Any:
    """Angle, direction, point and normal of a matrix that shears."""
    angle, direction, normal, point = shears.aff2sadn(matrix)
    return angle, direction, point, normal


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


def orthogonalization_matrix(lengths: Any, angles: Any) -> Any:
    """The matrix from the coordinates of a crystal's cell to orthogonal ones; angles in degrees."""
    a, b, c = lengths
    sines, cosines = np.sin(np.radians(angles)), np.cos(np.radians(angles))
    mixed = (cosines[0] * cosines[1] - cosines[2]) / (sines[0] * sines[1])
    matrix = np.identity(4)
    matrix[0, 0] = a * sines[1] * math.sqrt(1 - mixed * mixed)
    matrix[1, :2] = -a * sines[1] * mixed, b * sines[0]
    matrix[2, :3] = a * cosines[1], b * cosines[0], c
    return matrix


def clip_matrix(
    left: float,
    right: float,
    bottom: float,
    top: float,
    near: float,
    far: float,
    perspective: bool = False,
) -> Any:
    """The matrix from the visible part of a scene to coordinates from -1 to 1.

    Raises:
        ValueError: the bounds are not in order, or `near` is not in front of the camera.
    """
    if left >= right or bottom >= top or near >= far:
        raise ValueError("invalid frustrum")
    if perspective and near <= EPSILON:
        raise ValueError("invalid frustrum: near <= 0")
    low, high = numbers((left, bottom, near)), numbers((right, top, far))
    sums, sizes = high + low, high - low
    matrix = np.identity(4)
    if perspective:
        matrix[0, 0], matrix[1, 1] = -2 * near / sizes[:2]
        matrix[:2, 2] = sums[:2] / sizes[:2]
        matrix[2, 2:] = -sums[2] / sizes[2], 2 * near * far / sizes[2]
        matrix[3, 2:] = -1.0, 0.0
    else:
        matrix[:3, :3] = np.diag(2 / sizes)
        matrix[:3, 3] = -sums / sizes
    return matrix


def projection_matrix(
    point: Any, normal: Any, direction: Any = None, perspective: Any = None, pseudo: bool = False
) -> Any:
    """The matrix that projects to the plane of point and normal.

    Args:
        point: a point of the plane.
        normal: the normal of the plane.
        direction: the direction of a parallel projection; the normal by default.
        perspective: the eye of a perspective projection.
        pseudo: keep the depth of a perspective projection.
    """
    point, normal = numbers(point[:3]), unit_vector(normal[:3])
    height = float(np.dot(point, normal))
    matrix = np.identity(4)
    if perspective is None:
        along = normal if direction is None else numbers(direction[:3])
        along = along / np.dot(along, normal)
        matrix[:3, :3] -= np.outer(along, normal)
        matrix[:3, 3] = along * height
        return matrix
    eye = numbers(perspective[:3])
    matrix[:3, :3] *= np.dot(eye - point, normal)
    matrix[:3, :3] -= np.outer(eye, normal)
    matrix[:3, 3] = height * eye
    if pseudo:
        matrix[:3, :3] -= np.outer(normal, normal)
        matrix[:3, 3] = height * (eye + normal)
    matrix[3] = *-normal, np.dot(eye, normal)
    return matrix


def projection_from_matrix(matrix: Any, pseudo: bool = False) -> Any:
    """Point, normal, direction, perspective and `pseudo`, as `projection_matrix` takes them.

    Raises:
        ValueError: the matrix is not a projection.
    """
    matrix = numbers(matrix)
    fixed = [] if pseudo else _eigenvectors(matrix, 1.0)
    if fixed:
        point = fixed[-1] / fixed[-1][3]
        if not (lost := _eigenvectors(matrix[:3, :3], 0.0)):
            raise ValueError("no eigenvector corresponding to eigenvalue 0")
        direction = unit_vector(lost[0])
        if normals := _eigenvectors(matrix[:3, :3].T, 0.0):
            return point, unit_vector(normals[0]), direction, None, False
        return point, direction, None, None, False
    values, vectors = np.linalg.eig(matrix)
    kept = np.where(np.abs(np.real(values)) > 1e-8)[0]
    if not len(kept):
        raise ValueError("no eigenvector not corresponding to eigenvalue 0")
    point = np.real(vectors[:, kept[-1]])
    point = point / point[3]
    normal = -matrix[3, :3]
    eye = matrix[:3, 3] / np.dot(point[:3], normal)
    return point, normal, None, eye - normal if pseudo else eye, pseudo


def _eigenvectors(matrix: Any, value: float) -> list[Any]:
    """The eigenvectors of a matrix for one eigenvalue."""
    values, vectors = np.linalg.eig(matrix)
    return [np.real(vectors[:, i]) for i in np.where(np.abs(np.real(values) - value) < 1e-8)[0]]


def superimposition_matrix(v0: Any, v1: Any, scaling: bool = False, usesvd: bool = True) -> Any:
    """The matrix that moves points to given points as well as possible.

    Args:
        v0: the points, one in each column.
        v1: where they shall be.
        scaling: whether the matrix may scale.
        usesvd: find the rotation by a singular value decomposition, else by a quaternion.

    Raises:
        ValueError: the two do not have the same shape, or there are fewer than three points.
    """
    v0, v1 = numbers(v0)[:3], numbers(v1)[:3]
    if v0.shape != v1.shape or v0.shape[1] < 3:
        raise ValueError("Vector sets are of wrong shape or type.")
    center0, center1 = v0.mean(axis=1), v1.mean(axis=1)
    v0, v1 = v0 - center0[:, None], v1 - center1[:, None]
    matrix = np.identity(4)
    matrix[:3, :3] = _best_rotation(v1 @ v0.T, usesvd)
    if scaling:
        matrix[:3, :3] *= math.sqrt(np.sum(v1 * v1) / np.sum(v0 * v0))
    matrix[:3, 3] = center1 - matrix[:3, :3] @ center0
    return matrix


def _best_rotation(correlation: Any, usesvd: bool) -> Any:
    if usesvd:
        left, _, right = np.linalg.svd(correlation)
        if np.linalg.det(left @ right) < 0:  # a mirror image: turn the least important axis
            left[:, 2] *= -1
        return left @ right
    c = correlation.T
    w = (c[1, 2] - c[2, 1], c[2, 0] - c[0, 2], c[0, 1] - c[1, 0])
    symmetric = c + c.T - np.trace(c) * np.identity(3)
    matrix = np.empty((4, 4))
    matrix[:3, :3], matrix[3, :3], matrix[:3, 3] = symmetric, w, w
    matrix[3, 3] = np.trace(c)
    values, vectors = np.linalg.eigh(matrix)
    return quaternion_matrix(vectors[:, np.argmax(values)])[:3, :3]
