"""Type hashes are written as ROS writes them."""

import srvgen
from taskrpc.ros.packages.rclpy.type_hash import TypeHash, type_hash_of

String = srvgen.load("std_msgs/msg/String")


def test_a_type_hash_is_written_as_ros_writes_it():
    assert str(type_hash_of(String._HASH)) == String._HASH
    assert str(TypeHash()) == "INVALID"
    assert TypeHash(version=1, value=bytes(32)) == TypeHash(1, bytes(32))
    assert TypeHash(version=5) != TypeHash()
