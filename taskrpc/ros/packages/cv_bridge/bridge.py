"""Converts between image messages and arrays."""

from __future__ import annotations

import sys
from typing import Any

from sensor_msgs.msg import CompressedImage, Image

from taskrpc.ros.optional import needed

from .colours import converted
from .encodings import Encoding, encoding_of, name_of

np = needed("numpy", "cv_bridge")

_FORMATS = {"jpg": "jpg", "jpeg": "jpeg", "jpe": "jpg", "png": "png"}


class CvBridgeError(TypeError):
    """An image cannot be converted."""


class CvBridge:
    """Converts `sensor_msgs/msg/Image` and `CompressedImage` to arrays, and back."""

    def imgmsg_to_cv2(self, img_msg: Image, desired_encoding: str = "passthrough") -> Any:
        """The image as an array with rows, columns and, with more than one, channels.

        With `passthrough`, the array has the encoding of the message and shares its memory.

        Raises:
            CvBridgeError: the data do not fit, or there is no such conversion.
        """
        source = _encoding(img_msg.encoding)
        dtype = np.dtype(source.dtype).newbyteorder(">" if img_msg.is_bigendian else "<")
        row = img_msg.width * source.channels * dtype.itemsize
        step = img_msg.step or row
        if step < row or len(img_msg.data) < step * img_msg.height:
            raise CvBridgeError(
                f"expected {img_msg.height} rows of at least {row} bytes"
                f" ({img_msg.width} pixels of {source.name}), got step = {img_msg.step}"
                f" and {len(img_msg.data)} bytes"
            )
        shape: tuple[int, ...] = (img_msg.height, img_msg.width)
        strides: tuple[int, ...] = (step, dtype.itemsize * source.channels)
        if source.channels > 1:
            shape, strides = (*shape, source.channels), (*strides, dtype.itemsize)
        image = np.ndarray(shape=shape, dtype=dtype, buffer=img_msg.data, strides=strides)
        if not dtype.isnative:
            image = image.astype(source.dtype)
        if desired_encoding == "passthrough":
            return image
        return _converted(image, source, desired_encoding)

    def cv2_to_imgmsg(self, cvim: Any, encoding: str = "passthrough", header: Any = None) -> Image:
        """A message with the image; nothing is converted.

        With `passthrough`, the encoding is OpenCV's name of the type, such as `8UC3`.

        Raises:
            CvBridgeError: the encoding does not fit the type of the array.
        """
        _check(cvim)
        rows, columns = cvim.shape[:2]
        cv_type = self.dtype_with_channels_to_cvtype2(
            cvim.dtype, cvim.shape[2] if cvim.ndim > 2 else 1
        )
        if encoding != "passthrough" and _encoding(encoding).cv_type != cv_type:
            raise CvBridgeError(
                f"encoding specified as {encoding}, but image has incompatible type {cv_type}"
            )
        message = Image(
            height=rows,
            width=columns,
            encoding=cv_type if encoding == "passthrough" else encoding,
            is_bigendian=cvim.dtype.byteorder == ">"
            or (cvim.dtype.byteorder == "=" and sys.byteorder == "big"),
            step=cvim.nbytes // rows if rows else 0,
            data=np.ascontiguousarray(cvim).tobytes(),
        )
        if header is not None:
            message.header = header
        return message

    def compressed_imgmsg_to_cv2(
        self, cmprs_img_msg: CompressedImage, desired_encoding: str = "passthrough"
    ) -> Any:
        """The image of a JPEG or PNG as an array, `bgr8` with `passthrough`; needs OpenCV.

        Raises:
            CvBridgeError: the data are not an image, or there is no such conversion.
        """
        cv2 = needed("cv2", "a compressed image")
        data = np.frombuffer(cmprs_img_msg.data, dtype=np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
        if image is None:
            raise CvBridgeError(
                f"expected a compressed image of format {cmprs_img_msg.format!r},"
                f" got {len(data)} other bytes"
            )
        if desired_encoding == "passthrough":
            return image
        channels = image.shape[2] if image.ndim > 2 else 1
        source = {1: "mono", 3: "bgr", 4: "bgra"}[channels] + str(8 * image.itemsize)
        return _converted(image, encoding_of(source), desired_encoding)

    def cv2_to_compressed_imgmsg(self, cvim: Any, dst_format: str = "jpg") -> CompressedImage:
        """A message with the image as a JPEG, PNG or other format of OpenCV; needs OpenCV.

        Raises:
            CvBridgeError: OpenCV cannot write the array in this format.
        """
        cv2 = needed("cv2", "a compressed image")
        _check(cvim)
        try:
            is_written, data = cv2.imencode(f".{dst_format}", cvim)
        except cv2.error as error:
            raise CvBridgeError(str(error)) from None
        if not is_written:
            raise CvBridgeError(f"OpenCV cannot write this image as {dst_format}")
        return CompressedImage(format=_FORMATS.get(dst_format, dst_format), data=data.tobytes())

    def dtype_with_channels_to_cvtype2(self, dtype: Any, n_channels: int) -> str:
        """OpenCV's name of a type: `8UC3` for uint8 with three channels."""
        try:
            return name_of(np.dtype(dtype).name, n_channels)
        except ValueError as error:
            raise CvBridgeError(str(error)) from None

    def encoding_to_dtype_with_channels(self, encoding: str) -> tuple[str, int]:
        """NumPy's type and the channels of an encoding: `uint8` and 3 for `bgr8`."""
        found = _encoding(encoding)
        return found.dtype, found.channels

    def encoding_to_cvtype2(self, encoding: str) -> int:
        """OpenCV's number of the type of an encoding."""
        return getCvType(encoding)


def getCvType(encoding: str) -> int:
    """OpenCV's number of the type of an encoding: 16 for `bgr8`."""
    found = _encoding(encoding)
    depths = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
    return depths.index(found.dtype) + 8 * (found.channels - 1)


def cvtColor2(img: Any, encoding_in: str, encoding_out: str) -> Any:
    """An image in another encoding."""
    return _converted(img, _encoding(encoding_in), encoding_out)


def _converted(image: Any, source: Encoding, encoding: str) -> Any:
    try:
        return converted(image, source, encoding_of(encoding))
    except ValueError as error:
        raise CvBridgeError(str(error)) from None


def _encoding(name: str) -> Encoding:
    try:
        return encoding_of(name)
    except ValueError as error:
        raise CvBridgeError(str(error)) from None


def _check(image: Any) -> None:
    if not isinstance(image, np.ndarray | np.generic):
        raise TypeError("Your input type is not a numpy array")
    if image.ndim not in (2, 3):
        shape = "rows, columns and perhaps channels"
        raise CvBridgeError(f"expected an array with {shape}, got the shape {image.shape}")
