"""Classes for programs for ROS: numpy arrays, `SLOT_TYPES`, and fields that are checked when set.

The texts are those of real classes (rosidl_generator_py 0.24).
"""

from __future__ import annotations

import contextlib
import copy
import pickle
import sys
from array import array

import numpy
import pytest

import srvgen
from srvgen import from_cdr, to_cdr
from srvgen.classes import loader, rosidl_classes
from tests.srvgen.classes.rosidl_definition import define

pytestmark = pytest.mark.usefixtures("ros_classes")


def refused(action) -> str:
    with pytest.raises(AssertionError) as caught:
        action()
    return str(caught.value)


# --- numpy ----------------------------------------------------------------------------------------


def test_numeric_arrays_of_fixed_length_are_numpy_arrays():
    message = define("float64[36] covariance\nfloat32[] ranges\nbool[3] flags")()
    assert type(message.covariance) is numpy.ndarray
    assert message.covariance.dtype == numpy.float64
    assert message.covariance.reshape(6, 6).shape == (6, 6)
    assert isinstance(message.ranges, array)
    assert message.flags == [False] * 3


def test_array_of_two_dimensions_is_stored_and_read_flat():
    """rclpy sends such an array from wrong memory."""
    message = define("float64[36] covariance")()
    message.covariance = numpy.eye(6)
    assert message.covariance.shape == (36,)
    assert from_cdr(type(message), to_cdr(message)).covariance.reshape(6, 6)[5, 5] == 1.0


def test_change_of_a_numpy_array_changes_the_message_and_is_sent():
    message = define()()
    message.singles[1] = 2.5
    message.singles += 1
    message.bytes = [1, 2]
    assert message.singles.tolist() == [1.0, 3.5, 1.0]
    arrived = from_cdr(type(message), to_cdr(message))
    assert arrived.singles.tolist() == [1.0, 3.5, 1.0]
    assert arrived == message
    assert copy.deepcopy(message) == message
    assert srvgen.to_builtins(message)["bytes"] == [1, 2]


def test_arrays_of_numpy_are_printed_as_ros_prints_them():
    message = define("float64[2] pair\nfloat32[] ranges")(ranges=[1])
    assert repr(message) == "rosidl_msgs.msg.Everything(pair=array([0., 0.]), ranges=[1.0])"


def test_arrays_that_do_not_fit_are_refused_when_they_are_sent():
    message = define()(singles=[1.0, 2.0])
    assert message.singles.tolist() == [1.0, 2.0]
    with pytest.raises(srvgen.FieldError, match="singles: expected 3 elements, got 2"):
        to_cdr(message)


def test_without_numpy_arrays_of_fixed_length_are_those_of_other_programs(monkeypatch):
    rosidl_classes._numpy.cache_clear()
    monkeypatch.setitem(sys.modules, "numpy", None)
    try:
        assert define()().singles == [0.0, 0.0, 0.0]
        assert isinstance(define()().singles, array)
    finally:
        rosidl_classes._numpy.cache_clear()


def test_sending_and_receiving_does_not_import_numpy(monkeypatch):
    message = define()()
    monkeypatch.setattr(rosidl_classes, "_numpy", pytest.fail)
    from_cdr(type(message), to_cdr(message))


def test_existing_classes_do_not_change(monkeypatch):
    monkeypatch.setattr(loader, "_runtime_module", srvgen._runtime)
    made = define()
    assert isinstance(made().singles, array)
    assert not hasattr(made, "SLOT_TYPES")
    with pytest.raises(TypeError, match="check_fields"):
        made(check_fields=True)


# --- check_fields ---------------------------------------------------------------------------------

EACH = "field must be a set or sequence"


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("flag", 1, "field must be of type 'bool'"),
        ("raw", b"ab", "field must be of type 'bytes' or 'ByteString' with length 1"),
        ("small", 1.0, "field must be of type 'int'"),
        ("small", 300, "field must be an integer in [-128, 127]"),
        ("count", -1, "field must be an unsigned integer in [0, 65535]"),
        ("single", 1, "field must be of type 'float'"),
        ("single", 1e39, "field must be a float in [-3.402823466e+38, 3.402823466e+38]"),
        ("text", 5, "field must be of type 'str'"),
        ("short", "longer", "field must be string value not longer than 5"),
        ("inner", 5, "field must be a sub message of type 'Inner'"),
        ("singles", numpy.zeros(3), "numpy.ndarray() must have the dtype of 'numpy.float32'"),
        ("bytes", numpy.zeros(3, "B"), "numpy.ndarray() must have a size of 2"),
        ("bytes", [1, 256], f"{EACH} with length 2 and each value of type 'int' and each unsigned"
         " integer in [0, 255]"),
        ("flags", [True], f"{EACH} with length 2 and each value of type 'bool'"),
        ("longs", [1, 2, 3, 4], f"{EACH} with length <= 3 and each value of type 'int' and each"
         " integer in [-9223372036854775808, 9223372036854775807]"),
        ("longs", array("q", [1, 2, 3, 4]), "array.array() must have a size <= 3"),
        ("ranges", array("d"), "array.array() must have the type code of 'f'"),
        ("ranges", [1], f"{EACH} and each value of type 'float' and each float in"
         " [-340282346600000016151267322115014000640.000000,"
         " 340282346600000016151267322115014000640.000000]"),
        ("names", "abc", f"{EACH} and each value of type 'str'"),
        ("inners", [1], f"{EACH} and each value of type 'Inner'"),
    ],
)  # fmt: skip
def test_checked_fields_refuse_wrong_values_with_the_texts_of_ros(field, value, problem):
    cls = define()
    message = cls(check_fields=True)
    told = f"The '{field}' {problem}"
    assert refused(lambda: setattr(message, field, value)) == told
    assert refused(lambda: cls(check_fields=True, **{field: value})) == told
    is_too_large = field == "bytes" and isinstance(value, list)
    # The other fields are as lenient as in ROS.
    with pytest.raises(OverflowError) if is_too_large else contextlib.nullcontext():
        setattr(cls(), field, value)


def test_lists_of_numbers_are_checked_when_they_are_set():
    message = define()()
    for field, values, error in [
        ("ranges", ["x"], TypeError),
        ("ranges", 5, TypeError),
        ("longs", [1.5], TypeError),
        ("longs", [2**63], OverflowError),
        ("longs", "ab", TypeError),
        ("singles", ["x", "y", "z"], ValueError),
    ]:
        with pytest.raises(error):
            setattr(message, field, values)
        with pytest.raises(error):
            type(message)(**{field: values})
    assert message == type(message)()


def test_a_subclass_of_a_program_may_have_a_constructor_and_attributes():
    base = define("string data\nint32 count")

    class Counted(base):
        limit: int = 3

        def __init__(self, text, **fields):
            super().__init__(**fields)
            self.data = text
            self.seen = [text]

    message = Counted("a", count=2)
    assert (message.data, message.count, message.limit, message.seen) == ("a", 2, 3, ["a"])
    assert message == base(data="a", count=2)
    assert Counted.get_fields_and_field_types() == base.get_fields_and_field_types()
    assert to_cdr(message) == to_cdr(base(data="a", count=2))
    copied = copy.deepcopy(message)
    assert (copied, copied.seen) == (message, ["a"])
    assert copied.seen is not message.seen
    with pytest.raises(TypeError, match="Unexpected keyword argument 'missing'"):
        Counted("a", missing=1)


def test_a_program_can_add_methods_in_a_subclass():
    base = define("int32 number 3\nstring text")

    class Described(base):
        def described(self):
            return f"{self.text} {self.number}"

    assert Described(text="door").described() == "door 3"
    assert to_cdr(Described(text="door")) == to_cdr(base(text="door"))


def test_checked_fields_accept_valid_values():
    cls = define()
    message = cls(check_fields=True, single=float("inf"), inner=cls().inner)
    message.singles = numpy.ones(3, numpy.float32)
    message.ranges = (1.0, 2.0)
    message.longs = {1, 2}
    message.raw = b"a"
    assert message.singles.tolist() == [1.0, 1.0, 1.0]
    assert message.ranges == [1.0, 2.0]


def test_a_message_with_checked_fields_is_one_of_its_class():
    cls = define()
    checked, plain = cls(check_fields=True), cls()
    assert isinstance(checked, cls)
    assert checked == plain
    assert plain == checked
    assert repr(checked) == repr(plain)
    assert (checked._check_fields, plain._check_fields) == (True, False)
    assert to_cdr(checked) == to_cdr(plain)
    plain.inner = type(plain.inner)(check_fields=True, x=2.0)
    assert from_cdr(cls, to_cdr(plain)).inner.x == 2.0
    checked._check_fields = False
    checked.text = 5


def test_checked_messages_refuse_unknown_field_names():
    problem = refused(lambda: define()(check_fields=True, foo=1, bar=2))
    assert problem == "Invalid arguments passed to constructor: bar, foo"


def test_environment_variable_enables_checks_of_all_messages(monkeypatch):
    monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
    cls = define()
    assert refused(lambda: cls(text=5)) == "The 'text' field must be of type 'str'"
    assert type(cls()) is cls
    assert from_cdr(cls, to_cdr(cls(ranges=[1.0]))).ranges == [1.0]
    lenient = cls(check_fields=False, text=5, ranges=[1])
    assert (lenient.text, lenient.ranges) == (5, [1.0])


def test_messages_with_keywords_as_names_and_constants_are_made_and_checked():
    cls = srvgen.define("rosidl_msgs/msg/Odd", "int32 from\nint32[2] class\nint32 SIZE=2\n")
    message = cls(check_fields=True, **{"from": 1, "class": [1, 2]})
    assert (message.from_, message.class_.tolist(), cls.SIZE) == (1, [1, 2], 2)
    assert "The 'from' field" in refused(lambda: setattr(message, "from_", "x"))
    with pytest.raises(AttributeError, match="constant"):
        cls.SIZE = 3


def test_bundled_classes_can_be_pickled():
    cls = srvgen.load("geometry_msgs/msg/PoseWithCovariance")
    message = cls()
    message.covariance[1] = 2.0
    assert pickle.loads(pickle.dumps(message)) == message
