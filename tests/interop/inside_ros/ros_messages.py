"""Messages of srvgen and of ROS's own generated classes; `tests/interop/test_ros.py` runs it."""

from __future__ import annotations

import importlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

import srvgen
from taskrpc.middleware.ros.conversion import from_ros, to_ros
from taskrpc.middleware.ros.definitions import message_of_ros, service_of_ros
from taskrpc.middleware.ros.installed import ros_class

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

MESSAGES = [
    f"{package}/msg/{name}"
    for package in ("test_msgs", "std_msgs", "geometry_msgs")
    for name, found in vars(importlib.import_module(f"{package}.msg")).items()
    if isinstance(found, type)
]
SERVICES = ["std_srvs/srv/Trigger", "std_srvs/srv/SetBool", "std_srvs/srv/Empty"]
SERVICES += ["test_msgs/srv/Arrays", "test_msgs/srv/BasicTypes", "test_msgs/srv/Empty"]

_RANGES = {f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)}
_RANGES |= {f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)} | {"char": (0, 255)}
_ELEMENTS = {name: st.integers(*limits) for name, limits in _RANGES.items()} | {
    "bool": st.booleans(),
    "byte": st.binary(min_size=1, max_size=1),
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
}
# ROS encodes texts without the character 0, and wide ones in UTF-16 without surrogates.
_TEXT = st.characters(exclude_categories=["Cs"], exclude_characters="\0", max_codepoint=0xFFFF)


def messages(cls):
    """Any message of a class."""
    fields = {
        attribute: _values(type_, cls._NESTED.get(name))
        for (name, type_), attribute in zip(cls._FIELDS, cls.__struct_fields__, strict=True)
    }
    return st.builds(cls, **fields)


def _values(type_, nested):
    element, bracket, size = type_.partition("[")
    name, _, bound = element.partition("<=")
    if nested is not None:
        one = messages(nested)
    elif "string" in name:
        one = st.text(_TEXT, max_size=min(int(bound or 5), 5))
    else:
        one = _ELEMENTS[name]
    if not bracket:
        return one
    size = size.removesuffix("]")
    if size.isdecimal():
        return st.lists(one, min_size=int(size), max_size=int(size))
    return st.lists(one, max_size=int(size.removeprefix("<=") or 3))


@pytest.mark.parametrize("type_name", MESSAGES)
def test_ros_has_the_definition_and_the_hash_of_our_file(type_name):
    made = message_of_ros(type_name, ros_class(type_name), ros_class)
    try:
        ours = srvgen.load(type_name)
    except srvgen.DefinitionError:
        pytest.skip("srvgen has no file of this type")
    assert made is ours


@pytest.mark.parametrize("type_name", SERVICES)
def test_services_have_the_hash_of_our_file(type_name):
    made = service_of_ros(type_name, ros_class(type_name), ros_class)
    assert made._HASH == srvgen.load(type_name)._HASH


def _check(ours, ros, data):
    message = data.draw(messages(ours))
    message._check()
    made = to_ros(ours, ros)(message)
    # Each side reads what the other side has encoded.
    assert from_ros(ours, ros)(deserialize_message(srvgen.to_cdr(message), ros)) == message
    assert from_ros(ours, ros)(deserialize_message(serialize_message(made), ros)) == message
    assert from_ros(ours, ros)(made) == message


@pytest.mark.parametrize("type_name", [name for name in MESSAGES if "MultiNested" not in name])
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_message_is_the_same_for_both_encodings(type_name, data):
    ros = ros_class(type_name)
    _check(message_of_ros(type_name, ros, ros_class), ros, data)


@pytest.mark.parametrize("type_name", SERVICES)
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_request_and_response_is_the_same_for_both_encodings(type_name, data):
    ros = ros_class(type_name)
    ours = service_of_ros(type_name, ros, ros_class)
    _check(ours.Request, ros.Request, data)
    _check(ours.Response, ros.Response, data)
