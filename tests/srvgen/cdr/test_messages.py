"""CDR: the bytes of messages, and the errors of invalid bytes."""

from __future__ import annotations

import gc
import importlib
import sys
import threading
import weakref
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import srvgen
from srvgen import CdrError, from_cdr, load, to_cdr
from srvgen.cdr import messages
from srvgen.cdr.plan import KEPT_CLASSES, plan_of
from srvgen.classes.generate import generate
from srvgen.files.reading import read_definition
from srvgen.files.search import BUNDLED, Search
from tests.properties import examples
from tests.srvgen.cdr.reference import bundled_classes, random_message, reference_cdr
from tests.srvgen.cdr.tampered import tampered_classes
from tests.srvgen.sample_definitions import put_all

AddTwoInts = load("example_interfaces/srv/AddTwoInts")
Path_ = load("nav_msgs/msg/Path")
PoseStamped = load("geometry_msgs/msg/PoseStamped")
Bool = load("std_msgs/msg/Bool")


def define(text: str, name: str = "demo_msgs/msg/Demo") -> Any:
    return srvgen.define(name, text)


def message(text: str, **values: Any) -> Any:
    return define(text)(**values)


# --- bytes ----------------------------------------------------------------------------------------


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
def test_several_threads_may_encode_one_class_and_one_message_first():
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


def test_codecs_keep_a_limited_number_of_classes(monkeypatch):
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


Everything = tampered_classes()[0]


@pytest.mark.parametrize("package", sorted({cls._TYPE.split("/")[0] for cls in bundled_classes()}))
def test_random_messages_are_encoded_by_the_rules_and_decoded_again(package):
    random = Random(package)
    for cls in (one for one in bundled_classes() if one._TYPE.startswith(f"{package}/")):
        for most in (0, 1, 3):
            message = random_message(cls, random, most)
            data = to_cdr(message)
            assert data == reference_cdr(message)
            again = from_cdr(cls, data)
            assert repr(again) == repr(message)  # by which nan equals nan
            assert to_cdr(again) == data


@given(st.integers(0), st.integers(0, 9))
@settings(max_examples=examples(60))
def test_values_after_strings_and_sequences_are_aligned(seed, most):
    message = random_message(Everything, Random(seed), most)
    assert to_cdr(message) == reference_cdr(message)
    assert repr(from_cdr(Everything, to_cdr(message))) == repr(message)
