"""Messages as NumPy arrays and back, with the functions of the package `ros2_numpy`.

`numpify` returns the array of a message, `msgify` the message of an array. `conversions` registers
them by type, the other modules have one kind of message each. Only programs import this package.
"""

from . import geometry, image, occupancy_grid, point_cloud2
from .conversions import converts_from_numpy, converts_to_numpy, msgify, numpify

__all__ = [
    "converts_from_numpy",
    "converts_to_numpy",
    "geometry",
    "image",
    "msgify",
    "numpify",
    "occupancy_grid",
    "point_cloud2",
]
