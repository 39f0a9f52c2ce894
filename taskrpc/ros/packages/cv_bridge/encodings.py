"""The encodings of images: reads channels and bits from their names."""

from __future__ import annotations

import re
from typing import NamedTuple

_COLOURS = {
    "rgb8": (8, 3),
    "rgba8": (8, 4),
    "rgb16": (16, 3),
    "rgba16": (16, 4),
    "bgr8": (8, 3),
    "bgra8": (8, 4),
    "bgr16": (16, 3),
    "bgra16": (16, 4),
    "mono8": (8, 1),
    "mono16": (16, 1),
}
_YUV = dict.fromkeys(("yuv422", "yuv422_yuy2", "uyvy", "yuyv"), (8, 2))
_BAYER = {
    f"bayer_{pattern}{bits}": (bits, 1)
    for pattern in ("rggb", "bggr", "gbrg", "grbg")
    for bits in (8, 16)
}
_PLAIN = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C([1-4]?)")
_PLAIN_DTYPES = {
    "8U": "uint8",
    "8S": "int8",
    "16U": "uint16",
    "16S": "int16",
    "32S": "int32",
    "32F": "float32",
    "64F": "float64",
}


class Encoding(NamedTuple):
    """The parts of an encoding's name, such as `bgr8` or `32FC1`.

    Attributes:
        dtype: the name of NumPy's type of one channel.
        is_colour: whether the name says what the channels mean.
        by_opencv: whether only OpenCV converts its colours.
    """

    name: str
    dtype: str
    channels: int
    is_colour: bool
    by_opencv: bool

    @property
    def order(self) -> str:
        """The order of channels: `bgr`, `rgba`, `mono`."""
        return self.name.rstrip("0123456789")

    @property
    def cv_type(self) -> str:
        """OpenCV's name of the type, such as `8UC3`."""
        depth = next(depth for depth, dtype in _PLAIN_DTYPES.items() if dtype == self.dtype)
        return f"{depth}C{self.channels}"


def encoding_of(name: str) -> Encoding:
    """Return the encoding of a name; ValueError for an unknown name."""
    for known, by_opencv in ((_COLOURS, False), (_BAYER, True), (_YUV, True)):
        if name in known:
            bits, channels = known[name]
            return Encoding(name, f"uint{bits}", channels, True, by_opencv)
    if plain := _PLAIN.fullmatch(name):
        return Encoding(name, _PLAIN_DTYPES[plain[1]], int(plain[2] or 1), False, False)
    raise ValueError(f"Unrecognized image encoding [{name}]")


def name_of(dtype: str, channels: int) -> str:
    """The name for a NumPy type and channels: `8UC3` for `uint8` and 3."""
    for depth, each in _PLAIN_DTYPES.items():
        if each == dtype:
            return f"{depth}C{channels}"
    raise ValueError(f"expected an array of {', '.join(_PLAIN_DTYPES.values())}, got {dtype}")
