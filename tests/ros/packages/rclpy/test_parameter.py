"""Parameters keep their types, in Python, in messages and in files."""

from array import array

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.ros.packages.rclpy.parameter import (
    Parameter,
    ParameterMsg,
    ParameterType,
    ParameterValue,
    get_parameter_value,
    parameter_dict_from_yaml_file,
    parameter_value_to_python,
)

Type = Parameter.Type
int64 = st.integers(-(2**63), 2**63 - 1)
floats = st.floats(allow_nan=False)
values = (
    st.none()
    | st.booleans()
    | int64
    | floats
    | st.text()
    | st.lists(st.binary(min_size=1, max_size=1), min_size=1)
    | st.lists(st.booleans(), min_size=1)
    | st.lists(int64, min_size=1)
    | st.lists(floats, min_size=1)
    | st.lists(st.text(), min_size=1)
)


@given(values)
def test_value_is_unchanged_after_conversion_to_a_message_and_back(value):
    parameter = Parameter("p", value=value)
    again = Parameter.from_parameter_msg(parameter.to_parameter_msg())
    assert (again.name, again.type_) == ("p", parameter.type_)
    assert value == (list(again.value) if isinstance(value, list) else again.value)
    assert parameter_value_to_python(parameter.get_parameter_value()) == value
    assert parameter.type_.check(value)


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (None, Type.NOT_SET),
        (True, Type.BOOL),
        (42, Type.INTEGER),
        (2.41, Type.DOUBLE),
        ("x", Type.STRING),
        ([b"p", b"v"], Type.BYTE_ARRAY),
        ([], Type.BYTE_ARRAY),
        ((True, False), Type.BOOL_ARRAY),
        ([1, True], Type.INTEGER_ARRAY),
        (array("i", [1]), Type.INTEGER_ARRAY),
        (array("d", [1.0]), Type.DOUBLE_ARRAY),
        (["a"], Type.STRING_ARRAY),
    ],
)
def test_a_value_has_one_type(value, kind):
    parameter = Parameter("p", value=value)
    assert (parameter.type_, parameter.value) == (kind, value)
    assert str(kind) == f"Type.{kind.name}"


@pytest.mark.parametrize("value", [{"no": "dict"}, [1, "a"], [1, 2.0], b"bytes", 1j, [[1]]])
def test_a_value_that_no_parameter_can_have_is_refused(value):
    with pytest.raises(TypeError, match="allowed types"):
        Parameter("p", value=value)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (Type.NOT_SET, 1),
        (Type.BOOL, 1),
        (Type.DOUBLE, 1),
        (Type.BYTE_ARRAY, [b"ab"]),
        (Type.BYTE_ARRAY, b"ab"),
        (Type.STRING_ARRAY, array("i", [])),
        (Type.BOOL_ARRAY, 1),
    ],
)
def test_type_and_value_must_agree(kind, value):
    with pytest.raises(ValueError, match="do not agree"):
        Parameter("p", kind, value)


def test_a_type_is_one_of_the_enumeration():
    with pytest.raises(TypeError, match="type must be an instance of"):
        Parameter("p", "mytype", "x")


def test_an_array_of_numbers_prints_as_in_ros():
    sent = Parameter("p", value=[1, 2]).to_parameter_msg()
    received = srvgen.from_cdr(ParameterMsg, srvgen.to_cdr(sent))
    assert repr(Parameter.from_parameter_msg(received).value) == "array('q', [1, 2])"


def test_an_unknown_type_is_reported():
    with pytest.raises(RuntimeError, match="unexpected parameter type 42"):
        parameter_value_to_python(ParameterValue(type=42))


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("true", "BOOL", True),
        ("1", "INTEGER", 1),
        ("1.5", "DOUBLE", 1.5),
        ("hello", "STRING", "hello"),
        ("'1'", "STRING", "1"),
        ("", "STRING", ""),
        ("null", "STRING", "null"),
        ("{a: 1}", "STRING", "{a: 1}"),
        ("[1, a]", "STRING", "[1, a]"),
        ("a: b: c", "STRING", "a: b: c"),
        ("[]", "BOOL_ARRAY", []),
        ("[1, 2]", "INTEGER_ARRAY", [1, 2]),
        ("[1.5]", "DOUBLE_ARRAY", [1.5]),
        ("[a, b]", "STRING_ARRAY", ["a", "b"]),
    ],
)
def test_typed_text_gets_the_type_that_yaml_gives_it(text, kind, value):
    found = get_parameter_value(text)
    assert found.type == getattr(ParameterType, f"PARAMETER_{kind}")
    assert parameter_value_to_python(found) == value


DUMPED = """\
/**: {ros__parameters: {a: all, b: all}}
/robot:
  ros__parameters:
    a: 1
    motor: {gain: 2.5, names: [left, right]}
/ns: {deep: {ros__parameters: {c: 3}}}
"""


@pytest.fixture
def dumped(tmp_path):
    path = tmp_path / "dumped.yaml"
    path.write_text(DUMPED, encoding="utf-8")
    return str(path)


def _read(path, **choice):
    found = parameter_dict_from_yaml_file(path, **choice)
    assert all(name == message.name for name, message in found.items())
    return {name: parameter_value_to_python(one.value) for name, one in found.items()}


ROBOT = {"a": 1, "motor.gain": 2.5, "motor.names": ["left", "right"]}


def test_node_gets_the_parameters_of_its_entries_in_a_file(dumped):
    assert _read(dumped) == ROBOT | {"c": 3}
    assert _read(dumped, target_nodes=["/robot"]) == ROBOT
    assert _read(dumped, target_nodes=["/robot"], use_wildcard=True) == ROBOT | {"b": "all"}
    assert _read(dumped, target_nodes=["/ns/deep"], namespace="x.") == {"x.c": 3}


@pytest.mark.parametrize(
    ("target", "wildcards", "found"),
    [
        ("robot", False, {"a"}),
        ("/lab/robot", False, {"b"}),
        ("/lab/robot", True, {"b", "one", "any"}),
        ("/lab/north/robot", True, {"any"}),
        ("robot", True, {"a"}),
    ],
)
def test_names_of_nodes_in_a_file_may_have_wildcards(tmp_path, target, wildcards, found):
    path = tmp_path / "wild.yaml"
    names = {"robot": "a", "/lab/robot": "b", "/*/robot": "one", "/**/robot": "any"}
    lines = [f"{node}: {{ros__parameters: {{{name}: 1}}}}\n" for node, name in names.items()]
    path.write_text("".join(lines), encoding="utf-8")
    assert set(_read(str(path), target_nodes=[target], use_wildcard=wildcards)) == found
    assert set(_read(str(path))) == {"a", "b"}


def test_a_missing_entry_of_a_file_is_reported(dumped, tmp_path):
    with pytest.raises(RuntimeError, match="any valid parameters for /other, only for"):
        _read(dumped, target_nodes=["/other"])
    for text, problem in [
        ("/robot: 5", "not a valid ROS parameter file for node /robot"),
        ("/robot: {}", "not a valid ROS parameter file for node /robot"),
        ("/**: {ros__parameters: {a: 1}}", "does not contain any valid parameters"),
        ("", "does not contain any valid parameters"),
    ]:
        (tmp_path / "bad.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(RuntimeError, match=problem):
            _read(str(tmp_path / "bad.yaml"))


def test_a_type_equals_its_number_in_messages_and_has_a_name_in_texts():
    assert Parameter.Type.INTEGER == 2  # the number in ROS messages
    assert f"{Parameter.Type.INTEGER}" == str(Parameter.Type.INTEGER) == "Type.INTEGER"
