"""Transforms over topics, with ROS's `tf2_ros` functions: broadcasters, listeners, the buffer.

Start with `buffer`; the tree of frames behind it is in `tf2_py`. The programs of
`taskrpc run tf2_ros` are here too: `static_transform_publisher`, `tf2_echo`, `tf2_monitor` and
`buffer_server`. As in ROS, programs cannot import BufferServer from `tf2_ros` itself.
"""

# ROS's `tf2_ros` also contains these names of other packages, and programs import them from it.
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3Stamped,
)
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.time import Time
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)

from .buffer import Buffer
from .buffer_client import BufferClient
from .buffer_interface import (
    BufferInterface,
    ConvertRegistration,
    NotImplementedException,
    Stamped,
    TransformRegistration,
    TypeException,
    convert,
)
from .static_transform_broadcaster import StaticTransformBroadcaster
from .static_transform_listener import StaticTransformListener
from .transform_broadcaster import TransformBroadcaster
from .transform_listener import TransformListener

__all__ = [
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "ConnectivityException",
    "ConvertRegistration",
    "DurabilityPolicy",
    "Duration",
    "ExtrapolationException",
    "Header",
    "HistoryPolicy",
    "InvalidArgumentException",
    "LookupException",
    "Node",
    "NotImplementedException",
    "PointStamped",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "QoSProfile",
    "Stamped",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TFMessage",
    "Time",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TransformStamped",
    "TypeException",
    "Vector3Stamped",
    "convert",
]
