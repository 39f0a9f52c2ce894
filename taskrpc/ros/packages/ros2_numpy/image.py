"""Images as arrays with rows, columns and channels."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import Image

from taskrpc.ros.optional import needed

from .conversions import converts_from_numpy, converts_to_numpy

np = needed("numpy", "ros2_numpy")

_NAMED: dict[str, tuple[str, int]] = {
    **{f"{order}8": ("uint8", len(order)) for order in ("rgb", "rgba", "bgr", "bgra")},
    **{f"{order}16": ("uint16", len(order)) for order in ("rgb", "rgba", "bgr", "bgra")},
    "mono8": ("uint8", 1),
    "mono16": ("uint16", 1),
    "yuv422": ("uint8", 2),
}
_PLAIN = {
    "8U": "uint8",
    "8S": "int8",
    "16U": "uint16",
    "16S": "int16",
    "32S": "int32",
    "32F": "float32",
    "64F": "float64",
}


@converts_to_numpy(Image)
def image_to_numpy(msg: Image) -> Any:
    """The image as an array; one channel gives no third dimension."""
    dtype, channels = _type(msg.encoding)
    dtype = np.dtype(dtype).newbyteorder(">" if msg.is_bigendian else "<")
    return np.ndarray(
        shape=(msg.height, msg.width, channels),
        dtype=dtype,
        buffer=msg.data,
        strides=(msg.step, dtype.itemsize * channels, dtype.itemsize),
    )[..., 0 if channels == 1 else slice(None)]


@converts_from_numpy(Image)
def numpy_to_image(arr: Any, encoding: str) -> Image:
    """A message with the image, whose type must be that of the encoding."""
    dtype, channels = _type(encoding)
    got = arr.shape[2] if arr.ndim > 2 else 1
    if arr.dtype != dtype or got != channels:
        expected = f"an array of {dtype} with {channels} channels for {encoding}"
        raise TypeError(f"expected {expected}, got {arr.dtype} with {got}")
    return Image(
        encoding=encoding,
        height=arr.shape[0],
        width=arr.shape[1],
        step=arr.shape[1] * channels * arr.dtype.itemsize,
        is_bigendian=arr.dtype.byteorder == ">",
        data=np.ascontiguousarray(arr).tobytes(),
    )


def _type(encoding: str) -> tuple[str, int]:
    if encoding in _NAMED:
        return _NAMED[encoding]
    if encoding.startswith("bayer_"):
        return ("uint16" if encoding.endswith("16") else "uint8"), 1
    depth, _, channels = encoding.partition("C")
    if depth in _PLAIN and channels in ("", "1", "2", "3", "4"):
        return _PLAIN[depth], int(channels or 1)
    raise TypeError(f"Unrecognized encoding {encoding}")
