"""A program that uses zenoh-ros2-sdk: `zenoh_sdk_program.py PORT ACTION NAME`."""

from __future__ import annotations

import json
import sys
import threading
import time

import zenoh_ros2_sdk as sdk

REQUEST, RESPONSE = "bool data", "bool success\nstring message"
TYPES = {"request_definition": REQUEST, "response_definition": RESPONSE}


def say(value):
    print(json.dumps(value), flush=True)


def serve(port, name):
    response_type = []

    def handle(request):
        return response_type[0](success=request.data, message="from the SDK")

    server = sdk.ROS2ServiceServer(
        name, "std_srvs/srv/SetBool", handle, **TYPES, node_name="sdk", router_port=port
    )
    response_type.append(server.response_msg_class)
    say("ready")
    threading.Event().wait()  # the test kills this program


def call(port, name):
    client = sdk.ROS2ServiceClient(
        name, "std_srvs/srv/SetBool", **TYPES, node_name="sdk", router_port=port
    )
    response = client.call(data=True)
    say([response.success, response.message])


def publish(port, name):
    publisher = sdk.ROS2Publisher(
        name, "std_msgs/msg/String", "string data", node_name="sdk", router_port=port
    )
    say("ready")
    while True:
        publisher.publish(data="from the SDK")
        time.sleep(0.05)


def listen(port, name):
    sdk.ROS2Subscriber(
        name,
        "std_msgs/msg/String",
        lambda message: say(message.data),
        "string data",
        node_name="sdk",
        router_port=port,
    )
    say("ready")
    threading.Event().wait()  # the test kills this program


def discover(port, name):
    where = {"router_port": port}
    say(
        {
            "services": dict(sdk.get_service_names_and_types(**where)),
            "topics": dict(sdk.get_topic_names_and_types(**where)),
        }
    )


if __name__ == "__main__":
    globals()[sys.argv[2]](int(sys.argv[1]), sys.argv[3])
