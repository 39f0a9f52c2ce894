"""CDR: the bytes of messages, and the errors of invalid bytes."""

from __future__ import annotations

import gc
import importlib
import sys
import threading
import weakref
from typing import Any

import pytest

import srvgen
from srvgen import CdrError, FieldError, from_cdr, load, to_cdr
from srvgen.cdr import messages
from srvgen.cdr.plan import KEPT_CLASSES, plan_of
from srvgen.classes.generate import generate
from srvgen.files.reading import read_definition
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put_all

AddTwoInts = load("example_interfaces/srv/AddTwoInts")
SetBool = load("example_interfaces/srv/SetBool")
Trigger = load("example_interfaces/srv/Trigger")
Path_ = load("nav_msgs/msg/Path")
PoseStamped = load("geometry_msgs/msg/PoseStamped")
String = load("std_msgs/msg/String")
Bool = load("std_msgs/msg/Bool")
WString = load("example_interfaces/msg/WString")


def define(text: str, name: str = "demo_msgs/msg/Demo") -> Any:
    return srvgen.define(name, text)


def message(text: str, **values: Any) -> Any:
    return define(text)(**values)


# --- bytes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sent", "expected"),
    [
        (AddTwoInts.Request(a=2, b=3), "02000000 00000000 03000000 00000000"),
        (AddTwoInts.Response(sum=5), "05000000 00000000"),
        (SetBool.Response(success=True, message="ok"), "01000000 03000000 6f6b00"),
        (Trigger.Request(), "00"),
        (String(data="Zoë"), "05000000 5a6fc3ab00"),
        (String(data="a\0b"), "04000000 61006200"),
        (WString(data="é🤖"), "03000000 e9000000 3ed80000 16dd0000"),
        (message("uint8 a\nfloat64 b\nuint8 c\nuint16 d", a=1, b=0.0, c=2, d=3),
         "01000000 00000000 00000000 00000000 02000300"),
        (message("string s\nfloat64 x\nuint8 b", s="abc", x=1.0, b=9),
         "04000000 61626300 00000000 0000f03f 09"),
        (message("float64[] xs\nuint8 b", xs=[], b=9), "00000000 09"),
        (message("float64[] xs\nuint8 b", xs=[1.0], b=9),
         "01000000 00000000 00000000 0000f03f 09"),
        (message("bool[2] on\nbyte[] raw\nchar c", on=[True, False], raw=[b"\xff"], c=7),
         "01000000 01000000 ff07"),
        (message("string[] names\nuint16 n", names=["a", "", "bcd"], n=5),
         "03000000 02000000 61000000 01000000 00000000 04000000 62636400 0500"),
        (message("uint8 a\nstring[2] names", a=1, names=["a", "b"]),
         "01000000 02000000 61000000 02000000 6200"),
        (message("wstring[] names\nuint64 n", names=["a"], n=5),
         "01000000 01000000 61000000 00000000 05000000 00000000"),
        (message("int16[3] xs\nfloat64[2] ys", xs=[1, 2, -1], ys=[1, 2]),
         "01000200 ffff0000 00000000 0000f03f 00000000 00000040"),
    ],
    ids=lambda one: type(one).__name__ if hasattr(one, "_FIELDS") else "",
)  # fmt: skip
def test_layout_rule_gives_these_bytes(sent, expected):
    data = b"\0\1\0\0" + bytes.fromhex(expected)
    assert to_cdr(sent).hex(" ", -4) == data.hex(" ", -4)
    assert from_cdr(type(sent), data) == sent


def test_message_without_fields_is_always_one_byte():
    Event = load("std_srvs/srv/Trigger").Event
    full = to_cdr(Event(request=[load("std_srvs/srv/Trigger").Request()]))
    assert len(full) - len(to_cdr(Event())) == 4  # the byte, and three before the next count
    assert len(from_cdr(Event, full).request) == 1


def test_messages_are_checked_and_converted_before_encoding():
    scan = load("sensor_msgs/msg/LaserScan")(angle_min=0.1, ranges=[1, 2.5])
    data = to_cdr(scan)
    assert scan.angle_min != 0.1  # rounded to float32, as it is sent
    assert from_cdr(type(scan), data) == scan
    far = PoseStamped()
    far.pose.position.x = "far"
    with pytest.raises(FieldError, match=r"^poses\[1\]\.pose\.position\.x: expected float64"):
        to_cdr(Path_(poses=[PoseStamped(), far]))


def test_decoded_message_has_exact_types_and_passes_its_check():
    scan = load("sensor_msgs/msg/LaserScan")(ranges=[1, 2])
    arrived = from_cdr(type(scan), to_cdr(scan))
    assert type(arrived.ranges) is type(type(scan)().ranges)
    before = repr(arrived)
    arrived._check()
    assert repr(arrived) == before


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_bytes_are_decoded_and_not_kept(kind):
    image = load("sensor_msgs/msg/Image")(data=b"12", encoding="mono8")
    buffer = bytearray(to_cdr(image))
    arrived = from_cdr(type(image), kind(buffer))
    buffer[:] = bytes(len(buffer))
    assert arrived == image


@pytest.mark.parametrize(
    ("cls", "data", "problem"),
    [
        (AddTwoInts, b"", "expected a message class, such as AddTwoInts.Request, got "),
        (int, b"", "expected a message class"),
        (Bool, 5, "a bytes-like object is required"),
        (Bool, "00", "a bytes-like object is required"),
    ],
)
def test_wrong_argument_of_from_cdr_is_a_type_error(cls, data, problem):
    with pytest.raises(TypeError, match=problem):
        from_cdr(cls, data)


# --- what is read more generously than written ----------------------------------------------------


@pytest.mark.parametrize("extra", [0, 1, 2, 3])
def test_up_to_three_bytes_of_padding_may_follow(extra):
    assert from_cdr(Bool, b"\0\1\0\0\1" + b"\xff" * extra).data is True


def test_options_in_the_header_are_ignored():
    assert from_cdr(Bool, b"\0\1\xab\3\1").data is True


def test_string_of_length_0_is_decoded_as_empty():
    assert from_cdr(String, b"\0\1\0\0" + bytes(4)).data == ""
    names = define("string[] names\nstring last")
    arrived = from_cdr(names, b"\0\1\0\0" + bytes.fromhex("02000000 00000000 00000000 00000000"))
    assert (arrived.names, arrived.last) == (["", ""], "")


# --- what is refused, and where -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "data", "path", "problem"),
    [
        ("bool on", "", "", "expected a header of 4 bytes at byte 0, got the end at byte 3"),
        ("int32 x", "0102", "x", "expected int32 at byte 4, got the end at byte 6"),
        ("uint8 a\nint64 x", "01000000", "x", "expected int64 at byte 12, got the end at byte 8"),
        ("float64[4] c", "00", "c", "expected float64[4] at byte 4, got the end at byte 5"),
        ("string s", "0500", "s",
         "expected the length of a string at byte 4, got the end at byte 6"),
        ("string s", "05000000 616263", "s",
         "expected the NUL of a string at byte 12, got the end at byte 11"),
        ("string s", "ffffffff c3", "s",
         "expected the NUL of a string at byte 4294967302, got the end at byte 9"),
        ("string s", "03000000 61c300", "s", "expected UTF-8, got 0xc3 as byte 1 of the string"),
        ("string s", "03000000 edb080 00", "s", "expected UTF-8, got 0xed as byte 0 of the string"),
        ("string s", "02000000 6162", "s",
         "expected a string that ends in NUL, got another byte there"),
        ("string<=2 s", "04000000 61626300", "s", "expected at most 2 characters, got 3"),
        ("string[] s", "02000000 02000000 61000000 02000000 6162", "s[1]",
         "expected a string that ends in NUL, got another byte there"),
        ("string[] s", "01000000 02000000 ff00", "s[0]",
         "expected UTF-8, got 0xff as byte 0 of the string"),
        ("string[] s", "01000000 09000000 6100", "s[0]",
         "expected the NUL of a string at byte 20, got the end at byte 14"),
        ("string<=1[] s", "01000000 03000000 616200", "s[0]",
         "expected at most 1 characters, got 2"),
        ("string[] s", "ffffffff", "s",
         "expected 4294967295 elements, got 0 bytes, which cannot hold them"),
        ("string[2] s", "01000000 000000", "s",
         "expected 2 elements, got 7 bytes, which cannot hold them"),
        ("string[2] s", "04000000 610000", "s",
         "expected 2 elements, got 7 bytes, which cannot hold them"),
        ("string[2] s", "04000000 61620000", "s[1]",
         "expected the length of a string at byte 12, got the end at byte 12"),
        ("wstring s", "02000000 61000000", "s",
         "expected 2 code units, got 4 bytes, which cannot hold them"),
        ("wstring s", "01000000 00000100", "s", "expected UTF-16 code units, got 0x10000"),
        ("wstring s", "02000000 61000000 00d80000", "s",
         "expected UTF-16, got a lone surrogate as code unit 1"),
        ("wstring<=1 s", "02000000 61000000 62000000", "s", "expected at most 1 characters, got 2"),
        ("wstring[] s", "01000000 01000000 00dc0000", "s[0]",
         "expected UTF-16, got a lone surrogate as code unit 0"),
        ("wstring[] s", "01000000 05000000 00dc0000", "s[0]",
         "expected 5 code units, got 4 bytes, which cannot hold them"),
        ("bool on", "02", "on", "expected a bool as 0 or 1, got 2"),
        ("bool[] on", "03000000 0100ff", "on[2]", "expected a bool as 0 or 1, got 255"),
        ("bool[3] on", "010200", "on[1]", "expected a bool as 0 or 1, got 2"),
        ("float32[] x", "02000000 00000000", "x",
         "expected 2 elements, got 4 bytes, which cannot hold them"),
        ("uint8[] x", "ffffffff 00", "x",
         "expected 4294967295 elements, got 1 bytes, which cannot hold them"),
        ("uint8[<=2] x", "03000000 000000", "x", "expected at most 2 elements, got 3"),
        ("bool on", "01000000 01", "", "expected the message to end at byte 5, got 9 bytes"),
        ("uint8[] x", "00000000 00000000", "",
         "expected the message to end at byte 8, got 12 bytes"),
    ],
)  # fmt: skip
def test_invalid_bytes_give_an_error_with_the_path_of_the_field(text, data, path, problem):
    body = bytes.fromhex(data)
    with pytest.raises(CdrError) as caught:
        from_cdr(define(text), b"\0\1\0\0" + body if body else b"\0\1\0")
    assert (caught.value.path, caught.value.problem) == (path, problem)


def test_paths_lead_through_nested_messages_and_sequences():
    path = Path_(poses=[PoseStamped(), PoseStamped(), PoseStamped()])
    path.poses[2].header.frame_id = "map"
    data = to_cdr(path).replace(b"map", b"ma\xff")
    with pytest.raises(CdrError) as caught:
        from_cdr(Path_, data)
    assert str(caught.value) == (
        "poses[2].header.frame_id: expected UTF-8, got 0xff as byte 2 of the string"
    )
    with pytest.raises(CdrError, match=r"^poses\[2\]\.pose\.orientation\.w: expected float64 at"):
        from_cdr(Path_, data.replace(b"ma\xff", b"map")[:-1])


def test_more_messages_than_the_bytes_can_hold_are_refused_before_any_is_made():
    data = to_cdr(Path_())[:-4] + (2**32 - 1).to_bytes(4, "little") + bytes(64)
    with pytest.raises(CdrError, match=r"^poses: expected 4294967295 elements, got 64 bytes"):
        from_cdr(Path_, data)


@pytest.mark.parametrize(
    ("header", "what"),
    [
        ("00000000", "00 00, big-endian XCDR1"),
        ("00030000", "00 03, a parameter list"),
        ("00070000", "00 07, XCDR2"),
        ("00090000", "00 09, delimited XCDR2"),
        ("ffff0000", "ff ff, an unknown representation"),
    ],
)
def test_other_representations_are_refused_by_name(header, what):
    with pytest.raises(CdrError) as caught:
        from_cdr(Bool, bytes.fromhex(header) + b"\1")
    assert str(caught.value) == f"expected the header 00 01 of XCDR1, got {what}"


def test_cdr_error_is_a_field_error():
    """So one `except FieldError` covers a message, wherever it comes from."""
    assert issubclass(CdrError, FieldError)
    assert issubclass(CdrError, ValueError)


# --- classes of every origin ----------------------------------------------------------------------


def test_fields_named_like_keywords_can_be_used():
    renamed = message("int32 from\nstring class\nfloat32[] lambda", **{"from": 1, "class": "a"})
    arrived = from_cdr(type(renamed), to_cdr(renamed))
    assert (arrived.from_, arrived.class_, arrived.lambda_) == (1, "a", [])


@pytest.fixture
def generated(tmp_path, monkeypatch):
    """A package that `srvgen generate` wrote, with a runtime of its own."""
    definition = read_definition(BUNDLED / "nav_msgs" / "msg" / "Path.msg")
    files = generate({"nav_msgs": [definition]}, Search([BUNDLED]))
    put_all(files, tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("nav_msgs.msg")
    for name in [
        one for one in sys.modules if one.split(".")[0] in {path.split("/")[0] for path in files}
    ]:
        del sys.modules[name]


def test_classes_of_generated_packages_give_the_same_bytes(generated):
    ours = Path_(poses=[PoseStamped()])
    theirs = generated.Path(poses=[from_cdr(generated.Path, to_cdr(ours)).poses[0]])
    assert type(theirs).__module__ == "nav_msgs.msg._path"
    assert type(theirs) is not Path_
    assert to_cdr(theirs) == to_cdr(ours)
    theirs.poses[0].header.frame_id = 5
    with pytest.raises(srvgen.FieldError, match=r"^poses\[0\]\.header\.frame_id: expected string"):
        to_cdr(theirs)
    with pytest.raises(CdrError, match=r"^poses: expected"):
        from_cdr(generated.Path, to_cdr(ours)[:-60])


@pytest.mark.real_time
def test_threads_may_meet_at_the_first_encoding_of_a_class_and_at_one_message():
    cls = define("string[] names\nfloat32[] xs\n", "demo_msgs/msg/Shared")
    shared, start = cls(xs=range(50)), threading.Barrier(6)
    arrived: list[Any] = []

    def work() -> None:
        start.wait()
        arrived.extend(from_cdr(cls, to_cdr(shared)) for _ in range(50))

    threads = [threading.Thread(target=work) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert arrived == [shared] * 300


def test_classes_made_while_a_program_runs_are_not_kept_for_ever(monkeypatch):
    monkeypatch.setattr(messages, "KEPT_CLASSES", 3)
    for coders in (messages._encoders, messages._decoders):
        monkeypatch.setattr(coders, "_make", lambda cls: lambda given: b"")
        coders.clear()
    classes = []
    for number in range(10):
        made = srvgen.define(f"made{number}/msg/One", "int64 a\n")
        to_cdr(made())
        classes.append(weakref.ref(made))
        del made
    gc.collect()
    assert sum(each() is not None for each in classes) <= 4
    assert plan_of.cache_info().maxsize == KEPT_CLASSES
    for coders in (messages._encoders, messages._decoders):
        coders.clear()
