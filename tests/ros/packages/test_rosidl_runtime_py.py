"""Conversions of messages to and from dicts, YAML and comma-separated values."""

from collections import OrderedDict

import numpy
import pytest
import yaml

import srvgen
from srvgen.classes.slot_types import BasicType, NamespacedType, UnboundedSequence, UnboundedString
from taskrpc.ros.packages.rosidl_runtime_py import (
    get_action_interfaces,
    get_interface_packages,
    get_interface_path,
    get_interfaces,
    get_message_interfaces,
    get_message_slot_types,
    get_service_interfaces,
    message_to_csv,
    message_to_ordereddict,
    message_to_yaml,
    set_message_fields,
    utilities,
)
from taskrpc.ros.packages.rosidl_runtime_py.import_message import (
    import_message_from_namespaced_type,
)
from tests.srvgen.sample_definitions import put_all

PoseStamped = srvgen.load("geometry_msgs/msg/PoseStamped")
Log = srvgen.load("rcl_interfaces/msg/Log")
BasicTypes = srvgen.load("test_msgs/msg/BasicTypes")
Arrays = srvgen.load("test_msgs/msg/Arrays")
UnboundedSequences = srvgen.load("test_msgs/msg/UnboundedSequences")
Nested = srvgen.load("test_msgs/msg/Nested")
Time = srvgen.load("builtin_interfaces/msg/Time")


def test_a_message_is_a_dict_with_its_fields_in_order():
    found = message_to_ordereddict(PoseStamped())
    assert type(found) is OrderedDict
    assert list(found) == ["header", "pose"]
    assert type(found["pose"]) is OrderedDict
    assert found["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    numbers = message_to_ordereddict(UnboundedSequences(int32_values=[1, 2]))["int32_values"]
    assert (numbers, type(numbers)) == ([1, 2], list)


def test_message_is_yaml_in_order_and_on_one_line_with_flow_style():
    message = Log(stamp=Time(sec=1), name="robot", msg="it's late")
    text = message_to_yaml(message)
    assert text.splitlines()[:3] == ["stamp:", "  sec: 1", "  nanosec: 0"]
    assert yaml.safe_load(text) == message_to_ordereddict(message)
    assert message_to_yaml(Time(sec=1), flow_style=True) == "{sec: 1, nanosec: 0}\n"


def test_a_byte_is_a_character_of_yaml_and_itself_between_commas():
    message = BasicTypes(byte_value=b"\1", bool_value=True)
    assert message_to_ordereddict(message)["byte_value"] == "\1"
    assert message_to_csv(message) == r"True,b'\x01',0,0.0,0.0,0,0,0,0,0,0,0,0"
    assert message_to_ordereddict(Arrays())["byte_values"] == ["\0"] * 3


def test_long_parts_are_cut_off():
    message = UnboundedSequences(int32_values=[1, 2, 3], string_values=["abc"])
    short = message_to_ordereddict(message, truncate_length=2)
    assert short["int32_values"] == [1, 2, "..."]
    assert short["string_values"] == ["ab..."]
    bare = message_to_ordereddict(message, no_arr=True)
    assert bare["int32_values"] == "<sequence type: int32, length: 3>"
    assert message_to_csv(Log(name="robot"), no_str=True).split(",")[3] == "<string length: <5>>"


def test_fields_are_set_and_the_others_stay():
    message = BasicTypes(int32_value=42, char_value=3)
    assert set_message_fields(message, {"bool_value": True, "char_value": "7"}) == []
    assert (message.bool_value, message.char_value, message.int32_value) == (True, 7, 42)


@pytest.mark.usefixtures("ros_classes")
def test_array_of_numpy_takes_the_values_of_a_list():
    message = srvgen.define("runtime_msgs/msg/Fixed", "float64[3] values\n")()
    set_message_fields(message, {"values": [1, "2", 3.5]})
    assert message.values.tolist() == [1.0, 2.0, 3.5]
    given = numpy.ones(3)
    set_message_fields(message, {"values": given})
    given[0] = 9
    assert message.values.tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(ValueError, match="many"):
        set_message_fields(message, {"values": ["many"]})


def test_messages_in_a_message_are_dicts_or_messages():
    message, values = (
        UnboundedSequences(),
        {"basic_types_values": [{"int8_value": 42}, BasicTypes()]},
    )
    for _ in range(2):
        set_message_fields(message, values)
        assert message.basic_types_values == [BasicTypes(int8_value=42), BasicTypes()]
    nested = Nested()
    set_message_fields(nested, {"basic_types_value": {"float64_value": 1}})
    assert nested.basic_types_value.float64_value == 1.0


@pytest.mark.parametrize(
    ("values", "kind", "problem"),
    [
        ({"nothing": 1}, AttributeError, "nothing"),
        ({"int32_value": "many"}, ValueError, "many"),
        ("all", TypeError, "Value 'all' is expected to be a dictionary but is a str"),
    ],
)
def test_a_wrong_value_is_refused(values, kind, problem):
    with pytest.raises(kind, match=problem):
        set_message_fields(BasicTypes(), values)


def test_now_and_auto_stand_for_a_time_if_allowed():
    message = PoseStamped()
    setters = set_message_fields(message, {"header": "auto"}, True, True)
    setters += set_message_fields(
        message, {"header": {"stamp": "now", "frame_id": "map"}}, True, True
    )
    setters[-1](Time(sec=2))
    assert (message.header.stamp.sec, message.header.frame_id, len(setters)) == (2, "map", 2)
    with pytest.raises(TypeError, match=r"^Value 'auto' is expected to be a dictionary"):
        set_message_fields(message, {"header": "auto"})
    with pytest.raises(TypeError, match=r"^Value 'now' is expected to be a dictionary"):
        set_message_fields(message, {"header": {"stamp": "now"}})


def test_interfaces_are_listed_by_their_packages_and_kinds(tmp_path, monkeypatch):
    put_all({"src/plain/package.xml": "<package><name>plain</name></package>"}, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert get_interfaces(["plain", "std_srvs"]).keys() == {"std_srvs"}
    packages = get_interface_packages()
    assert {"std_msgs", "test_msgs"} <= set(packages)
    assert set(get_interfaces()) == set(packages)
    assert "msg/String" in get_interfaces()["std_msgs"]
    test_msgs = get_interfaces(["test_msgs"])
    assert list(test_msgs) == ["test_msgs"]
    assert {"msg/BasicTypes", "srv/Empty", "action/Fibonacci"} <= set(test_msgs["test_msgs"])
    assert get_action_interfaces(["test_msgs", "std_msgs"]) == {
        "test_msgs": [name for name in test_msgs["test_msgs"] if name.startswith("action/")]
    }
    assert "std_srvs" not in get_message_interfaces()
    assert get_service_interfaces(["std_srvs"]) == {
        "std_srvs": ["srv/Empty", "srv/SetBool", "srv/Trigger"]
    }
    for ask in (get_interfaces, get_message_interfaces):
        with pytest.raises(LookupError, match="Unknown package 'no_such_package'"):
            ask(["no_such_package"])


def test_the_file_of_an_interface_is_found_with_and_without_its_ending():
    path = get_interface_path("test_msgs/msg/BasicTypes")
    assert path == get_interface_path("test_msgs/msg/BasicTypes.msg")
    assert path.endswith("BasicTypes.msg")
    for name in ("test_msgs/msg/NoSuch", "test_msgs/msg/BasicTypes.idl", "no_such/msg/A"):
        with pytest.raises(LookupError, match="Could not find the interface"):
            get_interface_path(name)
    with pytest.raises(ValueError, match="at least two parts"):
        get_interface_path("BasicTypes")


def test_message_slot_types_are_given_by_field_name():
    types = get_message_slot_types(Log())
    assert list(types) == list(Log.get_fields_and_field_types())
    assert types["stamp"] == NamespacedType(["builtin_interfaces", "msg"], "Time")
    assert (types["level"], types["msg"]) == (BasicType("uint8"), UnboundedString())


def test_interfaces_are_recognised_by_type_name_and_attributes():
    assert utilities.get_namespaced_type("std_msgs/String").namespaces == ["std_msgs", "msg"]
    trigger = utilities.get_service_namespaced_type("std_srvs/Trigger")
    assert trigger == NamespacedType(["std_srvs", "srv"], "Trigger")
    Trigger = srvgen.load("std_srvs/srv/Trigger")
    Fibonacci = srvgen.load("test_msgs/action/Fibonacci")
    kinds = (utilities.is_message, utilities.is_service, utilities.is_action)
    told = [[is_one(cls) for is_one in kinds] for cls in (Log, Trigger, Fibonacci)]
    assert told == [[True, False, False], [False, True, False], [False, False, True]]
    with pytest.raises(ValueError, match="package/action/Name, got 'a/srv/B'"):
        utilities.get_action_namespaced_type("a/srv/B")


def test_a_class_is_imported_by_its_type():
    name = NamespacedType("taskrpc.ros.packages.rosidl_runtime_py".split("."), "message_to_yaml")
    assert import_message_from_namespaced_type(name) is message_to_yaml
    with pytest.warns(DeprecationWarning, match="AbstractNestedType"):
        found = import_message_from_namespaced_type(UnboundedSequence(name))
    assert found is message_to_yaml
    with pytest.raises(TypeError, match="expected a NamespacedType, got BasicType"):
        import_message_from_namespaced_type(BasicType("int8"))
