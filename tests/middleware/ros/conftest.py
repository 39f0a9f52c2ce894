"""The engine on a fake rclpy; `tests/interop/test_ros.py` tests it on the real one."""

from __future__ import annotations

import pytest

from taskrpc.middleware.ros import conversion, installed, native_services, ros_engine, types
from tests.middleware.ros import fake_ros

BUILT = {"std_msgs", "std_srvs", "geometry_msgs", "test_msgs", "builtin_interfaces"}
"""The packages that the fake ROS has built."""


def fake_class(type_name):
    package, kind, _ = type_name.split("/")
    if package not in BUILT:
        raise installed.NotBuilt(type_name)
    action, part = installed.action_part(type_name)
    if action:
        return getattr(fake_ros.ros_action(action).Impl, part)
    if kind == "action":
        return fake_ros.ros_action(type_name)
    return fake_ros.ros_service(type_name) if kind == "srv" else fake_ros.ros_message(type_name)


@pytest.fixture
def ros(monkeypatch):
    """A fake rclpy in place of the real one."""
    made = fake_ros.Ros()
    for module in (ros_engine, types):
        monkeypatch.setattr(module, "ros_class", fake_class)
    monkeypatch.setattr(ros_engine, "real_rclpy", lambda: made)
    monkeypatch.setattr(conversion, "message_class", lambda name: fake_class(name))
    monkeypatch.setattr(native_services, "_POLL", 0.001)
    monkeypatch.setattr(ros_engine, "DISCOVERY", 0.0)
    monkeypatch.setattr(ros_engine, "SETTLE", 0.0)
    monkeypatch.setattr(ros_engine, "SETTLE_ALONE", 0.0)
    return made
