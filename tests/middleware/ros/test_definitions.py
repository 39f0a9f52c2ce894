"""Our classes, made from ROS's generated classes."""

from __future__ import annotations

import pytest

import srvgen
from taskrpc.middleware.ros.definitions import message_of_ros, service_of_ros
from tests.middleware.ros import fake_ros
from tests.middleware.ros.test_conversion import TYPES


@pytest.mark.parametrize("type_name", TYPES)
def test_generated_class_has_the_hash_of_its_file(type_name):
    made = message_of_ros(type_name, fake_ros.ros_message(type_name), fake_ros.ros_message)
    assert made is srvgen.load(type_name)


@pytest.mark.parametrize("type_name", ["std_srvs/srv/SetBool", "test_msgs/srv/Arrays"])
def test_service_has_the_hash_of_its_file(type_name):
    made = service_of_ros(type_name, fake_ros.ros_service(type_name), fake_ros.ros_message)
    assert made._HASH == srvgen.load(type_name)._HASH


def test_class_that_srvgen_does_not_find_is_made_from_its_fields():
    class Door:
        @classmethod
        def get_fields_and_field_types(cls):
            return {
                "open": "boolean",
                "name": "string<8>",
                "angles": "sequence<double, 3>",
                "codes": "octet[2]",
                "labels": "sequence<string<4>>",
                "pose": "geometry_msgs/Pose",
            }

    made = message_of_ros("house_msgs/msg/Door", Door, fake_ros.ros_message)
    assert dict(made._FIELDS) == {
        "open": "bool",
        "name": "string<=8",
        "angles": "float64[<=3]",
        "codes": "byte[2]",
        "labels": "string<=4[]",
        "pose": "geometry_msgs/Pose",
    }
