"""Type checks and conversions of message fields, with and without `check_fields`."""

import array

import numpy
from geometry_msgs.msg import Point, Pose, PoseArray, TransformStamped
from rcl_interfaces.msg import Log
from shared import attempt, end
from std_msgs.msg import Bool, Byte, Char, Float32, Header, Int8, Int64, String, UInt8
from test_msgs.msg import Arrays, BoundedSequences, Strings, UnboundedSequences, WStrings

for cls in (Bool, Byte, Char, Float32, Int8, Int64, UInt8, String):
    for value in (1, -1, 300, 2**70, 1.5, True, "a", b"a", b"ab", None, [], float("nan"), 1e300):
        name = f"{cls.__name__} {value!r}"
        attempt(name, lambda cls=cls, value=value: cls(data=value, check_fields=True))
for what, action in {
    "unknown field": lambda: String(dta="a"),
    "positional": lambda: String("a"),
    "unknown attribute": lambda: setattr(String(), "dta", "a"),
    "nested": lambda: Pose(position=Point(x=1.0), check_fields=True).position.x,
    "wrong nested": lambda: Pose(position=Header(), check_fields=True),
    "nested dict": lambda: Pose(position={"x": 1.0}, check_fields=True),
    "messages": lambda: len(PoseArray(poses=[Pose()], check_fields=True).poses),
    "wrong messages": lambda: PoseArray(poses=[Point()], check_fields=True),
    "tuple of messages": lambda: type(PoseArray(poses=(Pose(),), check_fields=True).poses).__name__,
    "generator": lambda: PoseArray(poses=(Pose() for _ in range(2)), check_fields=True),
    "fixed array": lambda: Arrays(int32_values=[1, 2], check_fields=True),
    "fixed array of 3": lambda: Arrays(int32_values=[1, 2, 3], check_fields=True).int32_values,
    "fixed strings": lambda: Arrays(string_values=["a", "b"], check_fields=True),
    "numpy": lambda: Arrays(int32_values=numpy.zeros(3, numpy.int32)).int32_values,
    "numpy of another type": lambda: Arrays(int32_values=numpy.zeros(3, numpy.int64)).int32_values,
    "array": lambda: UnboundedSequences(int32_values=array.array("i", [1])).int32_values,
    "array of another type": lambda: UnboundedSequences(int32_values=array.array("d", [1])),
    "bytes": lambda: UnboundedSequences(uint8_values=b"ab").uint8_values,
    "byte values": lambda: (
        UnboundedSequences(byte_values=[b"a", b"b"], check_fields=True).byte_values
    ),
    "wrong byte values": lambda: UnboundedSequences(byte_values=[1], check_fields=True),
    "bounded": lambda: BoundedSequences(int32_values=[1, 2, 3, 4], check_fields=True),
    "bounded strings": lambda: BoundedSequences(string_values=["a"] * 4, check_fields=True),
    "bounded bools": lambda: BoundedSequences(bool_values=[True, 1], check_fields=True),
    "bounded string": lambda: Strings(bounded_string_value="x" * 23, check_fields=True),
    "wide": lambda: WStrings(wstring_value="ü", check_fields=True).wstring_value,
    "wide bytes": lambda: WStrings(wstring_value=b"u", check_fields=True),
    "equal": lambda: (String(data="a") == String(data="a"), String() == Bool(), String() != 1),
    "default": lambda: (Log().level, Strings().string_value_default1),
    "constants": lambda: (Log.INFO, Log().INFO),
    "set constant": lambda: setattr(Log, "INFO", 5),
    "read constant": lambda: type(Log.ERROR).__name__,
    "fields": lambda: Header.get_fields_and_field_types(),
    "slots": lambda: Point.__slots__,
    "types": lambda: [type(each).__name__ for each in PoseArray.SLOT_TYPES],
    "text": lambda: str(TransformStamped()),
    "hashed": lambda: hash(String()),
    "array text": lambda: repr(UnboundedSequences(uint8_values=[1], bool_values=[True])).count(","),
}.items():
    attempt(what, action)
end()
