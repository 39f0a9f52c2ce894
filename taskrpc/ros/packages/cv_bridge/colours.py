"""Converts arrays from one encoding to another, with OpenCV's results."""

from __future__ import annotations

from typing import Any

from taskrpc.ros.optional import needed

from .encodings import Encoding

_GREY = {"r": 9798, "g": 19235, "b": 3735}
"""How much each colour adds to grey, in 1/32768: OpenCV's numbers."""


def converted(image: Any, source: Encoding, target: Encoding) -> Any:
    """A new array in the target encoding; ValueError if there is no such conversion.

    The rules and the texts of errors are those of ROS's `cv_bridge`.
    """
    same = source.channels == target.channels
    if source.name == target.name:
        return image.copy()
    if not source.is_colour:
        if target.is_colour:
            said = f"[{source.name}] is not a color format. but [{target.name}] is."
            raise ValueError(f"{said} The conversion does not make sense")
        if not same:
            said = f"[{source.name}] and [{target.name}] do not have the same number of channel"
            raise ValueError(said)
        return _with_depth(image, source, target)
    if not target.is_colour:
        if not same:
            said = f"[{source.name}] is a color format but [{target.name}] is not so they must"
            raise ValueError(f"{said} have the same OpenCV type, CV_8UC3, CV16UC1 ....")
        return _with_depth(image, source, target)
    if target.by_opencv:
        raise ValueError(f"Unsupported conversion from [{source.name}] to [{target.name}]")
    if source.by_opencv:
        image = _by_opencv(image, source, target)
    elif source.order != target.order:
        image = _reordered(image, source.order, target.order)
    return _with_depth(image, source, target)


def _reordered(image: Any, source: str, target: str) -> Any:
    np = needed("numpy", "cv_bridge")
    if source == "mono":
        planes = dict.fromkeys("rgb", image)
    else:
        planes = {name: image[..., number] for number, name in enumerate(source)}
    if target == "mono":
        parts = [planes[name].astype(np.int64) * _GREY[name] for name in "rgb"]
        return ((sum(parts) + 16384) >> 15).astype(image.dtype)
    opaque = np.iinfo(image.dtype).max
    planes.setdefault("a", np.full(image.shape[:2], opaque, image.dtype))
    return np.stack([planes[name] for name in target], axis=-1)


def _with_depth(image: Any, source: Encoding, target: Encoding) -> Any:
    if source.dtype == target.dtype:
        return image.copy()
    np = needed("numpy", "cv_bridge")
    bits = {"uint8": 255, "uint16": 65535, "int8": 255, "int16": 65535}
    # Only 8 and 16 bits are scaled to each other, as in ROS.
    scale = bits.get(target.dtype, 0) / bits.get(source.dtype, 1)
    values = image.astype(np.float64)
    if source.dtype in bits and target.dtype in bits and scale != 1:
        values *= scale
    if target.dtype.startswith("float"):
        return values.astype(target.dtype)
    limits = np.iinfo(target.dtype)
    return np.clip(np.rint(values), limits.min, limits.max).astype(target.dtype)


def _by_opencv(image: Any, source: Encoding, target: Encoding) -> Any:
    """Colours of Bayer and YUV images, still with the depth of the source."""
    cv2 = needed("cv2", f"an image with the encoding {source.name}")
    if source.name.startswith("bayer"):
        # OpenCV names a pattern by the second row, so its BG is ROS's rggb.
        code = {"rggb": "BG", "bggr": "RG", "gbrg": "GR", "grbg": "GB"}[source.order[-4:]]
        conversion = f"COLOR_BAYER_{code}2BGR"
    else:
        conversion = f"COLOR_YUV2BGR_{'YUY2' if 'yuy' in source.name else 'UYVY'}"
    made = cv2.cvtColor(image, getattr(cv2, conversion))
    return made if target.order == "bgr" else _reordered(made, "bgr", target.order)
