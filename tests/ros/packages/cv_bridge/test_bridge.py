"""Images as arrays."""

import importlib
import sys

import numpy as np
import pytest

IMAGE = np.arange(2 * 4 * 3, dtype=np.uint8).reshape(2, 4, 3) * 10


@pytest.fixture
def cv_bridge(ros_names):
    return importlib.import_module("cv_bridge")


@pytest.fixture
def bridge(cv_bridge):
    return cv_bridge.CvBridge()


@pytest.fixture
def cv2():
    return pytest.importorskip("cv2")


@pytest.mark.parametrize(
    ("dtype", "channels", "name"),
    [
        ("uint8", 1, "8UC1"),
        ("uint8", 3, "8UC3"),
        ("uint16", 1, "16UC1"),
        ("int16", 2, "16SC2"),
        ("float32", 1, "32FC1"),
        ("float64", 4, "64FC4"),
    ],
)
def test_array_and_message_have_the_same_pixels(bridge, dtype, channels, name):
    shape = (2, 4) if channels == 1 else (2, 4, channels)
    image = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    message = bridge.cv2_to_imgmsg(image)
    assert (message.encoding, message.height, message.width) == (name, 2, 4)
    assert message.step == 4 * channels * image.itemsize
    np.testing.assert_array_equal(bridge.imgmsg_to_cv2(message), image)


def test_header_and_encoding_of_a_message(bridge, cv_bridge):
    header = importlib.import_module("std_msgs.msg").Header(frame_id="camera")
    message = bridge.cv2_to_imgmsg(IMAGE, "bgr8", header=header)
    assert (message.encoding, message.header.frame_id) == ("bgr8", "camera")
    with pytest.raises(cv_bridge.CvBridgeError) as caught:
        bridge.cv2_to_imgmsg(IMAGE, "mono8")
    assert str(caught.value) == "encoding specified as mono8, but image has incompatible type 8UC3"
    with pytest.raises(TypeError, match="Your input type is not a numpy array"):
        bridge.cv2_to_imgmsg([[1]])


def test_passthrough_shares_the_memory_of_the_message(bridge):
    message = bridge.cv2_to_imgmsg(IMAGE, "bgr8")
    bridge.imgmsg_to_cv2(message)[0, 0, 0] = 77
    assert message.data[0] == 77


def test_big_endian_and_padded_rows(bridge):
    image = importlib.import_module("sensor_msgs.msg").Image
    message = image(height=2, width=1, encoding="16UC1", is_bigendian=1, step=4)
    message.data = b"\1\2..\3\4.."
    assert bridge.imgmsg_to_cv2(message).tolist() == [[0x0102], [0x0304]]


def test_too_few_bytes_and_unknown_encodings_are_explained(bridge, cv_bridge):
    image = importlib.import_module("sensor_msgs.msg").Image
    with pytest.raises(cv_bridge.CvBridgeError, match="2 rows of at least 6 bytes"):
        bridge.imgmsg_to_cv2(image(height=2, width=2, encoding="rgb8", data=[1, 2]))
    with pytest.raises(cv_bridge.CvBridgeError, match=r"Unrecognized image encoding \[cmyk\]"):
        bridge.imgmsg_to_cv2(image(encoding="cmyk"))


@pytest.mark.parametrize(
    ("source", "target", "said"),
    [
        (
            "8UC3",
            "bgr8",
            "[8UC3] is not a color format. but [bgr8] is. The conversion does not make sense",
        ),
        ("8UC3", "32FC1", "[8UC3] and [32FC1] do not have the same number of channel"),
        (
            "bgr8",
            "32FC1",
            "[bgr8] is a color format but [32FC1] is not so they must have the same OpenCV type,"
            " CV_8UC3, CV16UC1 ....",
        ),
        ("bgr8", "bayer_rggb8", "Unsupported conversion from [bgr8] to [bayer_rggb8]"),
    ],
)
def test_impossible_conversions_have_the_messages_of_ros(bridge, cv_bridge, source, target, said):
    with pytest.raises(cv_bridge.CvBridgeError) as caught:
        bridge.imgmsg_to_cv2(bridge.cv2_to_imgmsg(IMAGE, source), target)
    assert str(caught.value) == said


@pytest.mark.interop
@pytest.mark.parametrize(
    ("source", "target", "code"),
    [
        ("bgr8", "rgb8", "COLOR_BGR2RGB"),
        ("bgr8", "mono8", "COLOR_BGR2GRAY"),
        ("rgb8", "mono8", "COLOR_RGB2GRAY"),
        ("bgr8", "bgra8", "COLOR_BGR2BGRA"),
        ("bgr8", "rgba8", "COLOR_BGR2RGBA"),
        ("bgra8", "rgb8", "COLOR_BGRA2RGB"),
        ("rgba8", "mono8", "COLOR_RGBA2GRAY"),
        ("mono8", "bgr8", "COLOR_GRAY2BGR"),
        ("mono8", "rgba8", "COLOR_GRAY2RGBA"),
        ("mono16", "bgr16", "COLOR_GRAY2BGR"),
        ("rgb16", "mono16", "COLOR_RGB2GRAY"),
        ("bayer_rggb8", "bgr8", "COLOR_BayerBG2BGR"),
        ("bayer_grbg8", "rgb8", "COLOR_BayerGB2RGB"),
        ("yuv422", "bgr8", "COLOR_YUV2BGR_UYVY"),
        ("yuv422_yuy2", "rgb8", "COLOR_YUV2RGB_YUY2"),
    ],
)
def test_colours_are_those_of_opencv(bridge, cv2, source, target, code):
    dtype, channels = bridge.encoding_to_dtype_with_channels(source)
    shape = (8, 8) if channels == 1 else (8, 8, channels)
    image = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape).astype(dtype)
    found = bridge.imgmsg_to_cv2(bridge.cv2_to_imgmsg(image, source), target)
    np.testing.assert_array_equal(found, cv2.cvtColor(image, getattr(cv2, code)))


def test_depths_are_scaled_between_8_and_16_bits_only(bridge):
    grey = bridge.cv2_to_imgmsg(np.array([[0, 128, 255]], np.uint8), "mono8")
    assert bridge.imgmsg_to_cv2(grey, "mono16").tolist() == [[0, 32896, 65535]]
    deep = bridge.cv2_to_imgmsg(np.array([[0, 32768, 65535]], np.uint16), "mono16")
    assert bridge.imgmsg_to_cv2(deep, "mono8").tolist() == [[0, 128, 255]]
    depth = bridge.cv2_to_imgmsg(np.array([[1500]], np.uint16), "16UC1")
    assert bridge.imgmsg_to_cv2(depth, "32FC1").tolist() == [[1500.0]]


@pytest.mark.interop
def test_compressed_images(bridge, cv_bridge, cv2):
    message = bridge.cv2_to_compressed_imgmsg(IMAGE, "png")
    assert message.format == "png"
    np.testing.assert_array_equal(bridge.compressed_imgmsg_to_cv2(message), IMAGE)
    np.testing.assert_array_equal(
        bridge.compressed_imgmsg_to_cv2(message, "rgb8"), IMAGE[..., ::-1]
    )
    message.data = b"no picture"
    with pytest.raises(cv_bridge.CvBridgeError, match="expected a compressed image of format"):
        bridge.compressed_imgmsg_to_cv2(message)


def test_compressed_image_without_opencv_names_the_command(bridge, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ModuleNotFoundError, match="pip install opencv-python-headless"):
        bridge.cv2_to_compressed_imgmsg(IMAGE)


@pytest.mark.interop
def test_numbers_of_types_are_those_of_opencv(cv_bridge, cv2):
    for name, number in (("bgr8", cv2.CV_8UC3), ("32FC1", cv2.CV_32FC1), ("64FC2", cv2.CV_64FC2)):
        assert cv_bridge.getCvType(name) == number & 0xFFF or cv2.__version__ >= "5"
    assert cv_bridge.getCvType("bgr8") == 16
    assert cv_bridge.cvtColor2(IMAGE, "bgr8", "rgb8")[0, 0].tolist() == [20, 10, 0]
