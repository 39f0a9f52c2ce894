"""Quaternions, Euler angles and matrices, with the functions of ROS 2's `tf_transformations`.

Quaternions are (x, y, z, w), and matrices are arrays of 4 by 4 numbers. `rotations` has the
functions that programs use most. The package needs `transforms3d`, which brings numpy.
"""

from taskrpc.ros.optional import needed

needed("transforms3d", "tf_transformations")  # explains in one line that it is not installed

# ruff: noqa: E402 - the other modules import transforms3d
from .matrices import (
    compose_matrix,
    decompose_matrix,
    identity_matrix,
    translation_from_matrix,
    translation_matrix,
)
from .rotations import (
    euler_from_matrix,
    euler_from_quaternion,
    euler_matrix,
    quaternion_about_axis,
    quaternion_conjugate,
    quaternion_from_euler,
    quaternion_from_matrix,
    quaternion_inverse,
    quaternion_matrix,
    quaternion_multiply,
    quaternion_slerp,
    random_quaternion,
    random_rotation_matrix,
    rotation_from_matrix,
    rotation_matrix,
)
from .vectors import (
    concatenate_matrices,
    inverse_matrix,
    is_same_transform,
    random_vector,
    unit_vector,
    vector_norm,
)

__all__ = [
    "compose_matrix",
    "concatenate_matrices",
    "decompose_matrix",
    "euler_from_matrix",
    "euler_from_quaternion",
    "euler_matrix",
    "identity_matrix",
    "inverse_matrix",
    "is_same_transform",
    "quaternion_about_axis",
    "quaternion_conjugate",
    "quaternion_from_euler",
    "quaternion_from_matrix",
    "quaternion_inverse",
    "quaternion_matrix",
    "quaternion_multiply",
    "quaternion_slerp",
    "random_quaternion",
    "random_rotation_matrix",
    "random_vector",
    "rotation_from_matrix",
    "rotation_matrix",
    "translation_from_matrix",
    "translation_matrix",
    "unit_vector",
    "vector_norm",
]
