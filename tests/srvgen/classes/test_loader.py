"""`load`, `define` and `type_hash`: one class per definition, a new one when a file changes."""

from __future__ import annotations

import copy
import gc
import os
import pickle
import subprocess
import sys
import threading
import traceback
import weakref
from pathlib import Path

import msgspec
import pytest

import srvgen
from srvgen.classes import loader
from srvgen.definitions.lines import join_full_text
from srvgen.errors import DefinitionError
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A workspace that `load` searches first; removed after the test."""
    monkeypatch.setattr(loader, "_search", Search([tmp_path]))
    return tmp_path


def edit(path: Path, text: str) -> None:
    before = path.stat().st_mtime_ns
    path.write_text(text, encoding="utf-8")
    os.utime(path, ns=(before + 10**9, before + 10**9))


def test_a_service_has_request_response_and_event():
    add = srvgen.load("example_interfaces/srv/AddTwoInts")
    assert repr(add.Request(a=1, b=2)) == "example_interfaces.srv.AddTwoInts_Request(a=1, b=2)"
    assert str(add.Request) == "<class 'example_interfaces.srv._add_two_ints.AddTwoInts_Request'>"
    assert add.Event(request=[add.Request(a=1)]).request[0].a == 1
    assert (add._TYPE, add.Request._WIDTH) == ("example_interfaces/srv/AddTwoInts", 2)
    assert add._HASH == "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    assert srvgen.type_hash("example_interfaces/srv/AddTwoInts") == add._HASH


def test_derived_types_can_be_loaded_by_name():
    add = srvgen.load("example_interfaces/srv/AddTwoInts")
    assert srvgen.load("example_interfaces/srv/AddTwoInts_Request") is add.Request
    goal = srvgen.load("example_interfaces/action/Fibonacci_SendGoal")
    assert goal is srvgen.load("example_interfaces/action/Fibonacci").Impl.SendGoalService
    assert srvgen.type_hash(goal.Request._TYPE) == goal.Request._HASH
    with pytest.raises(DefinitionError, match="AddTwoInts_Nothing"):
        srvgen.load("example_interfaces/srv/AddTwoInts_Nothing")


def test_loading_leaves_no_module_behind():
    srvgen.load("shape_msgs/msg/SolidPrimitive")
    assert not [name for name in sys.modules if name.startswith("shape_msgs")]


def test_nested_classes_are_the_same_as_those_of_load():
    plan = srvgen.load("nav_msgs/srv/GetPlan")
    assert type(plan.Request().goal) is srvgen.load("geometry_msgs/msg/PoseStamped")


def test_the_same_class_comes_back_until_a_file_changes(folder):
    outer = put("demo_msgs/msg/Outer", "Inner inner\n", folder)
    inner = put("demo_msgs/msg/Inner", "int32 a\n", folder)
    first = srvgen.load("demo_msgs/msg/Outer")
    assert srvgen.load("demo_msgs/msg/Outer") is first
    edit(inner, "int32 a\nint32 b\n")
    second = srvgen.load("demo_msgs/msg/Outer")
    assert second is not first
    assert second().inner.b == 0
    os.utime(outer, ns=(5, 5))
    assert srvgen.load("demo_msgs/msg/Outer") is second, "touched, not changed"


def test_a_new_file_that_goes_before_another_is_noticed(folder):
    assert srvgen.load("std_srvs/srv/Trigger").Request._FIELDS == ()
    put("std_srvs/srv/Trigger", "int32 mine\n---\n", folder)
    assert srvgen.load("std_srvs/srv/Trigger").Request._FIELDS == (("mine", "int32"),)


@pytest.mark.parametrize("name", ["nav_msgs/srv/GetPlan", "example_interfaces/action/Fibonacci"])
def test_definition_from_a_server_gives_the_same_class(name):
    loaded = srvgen.load(name)
    assert srvgen.define(name, loaded._DEFINITION) is loaded


def test_define_reads_no_files(tmp_path, monkeypatch):
    monkeypatch.setattr(loader, "_search", Search([tmp_path]))
    put("far_msgs/msg/Inner", "int32 a 4\n", tmp_path)
    path = put("far_msgs/srv/Ask", "Inner inner\n---\n", tmp_path)
    text = srvgen.load("far_msgs/srv/Ask")._DEFINITION
    path.unlink()
    ask = srvgen.define("far_msgs/srv/Ask", text)
    message = ask.Request()
    assert copy.deepcopy(message).inner.a == 4
    other = srvgen.define("far_msgs/srv/Ask", text.replace("a 4", "a 5"))
    assert other is not ask
    assert other.Request().inner.a == 5


def full_text(own: str, **needed: str) -> str:
    """A service's text with the text of its event and of other types of its package."""
    names = ("service_msgs/msg/ServiceEventInfo", "builtin_interfaces/msg/Time")
    texts = {name: Search([BUNDLED]).text(name) for name in names}
    return join_full_text(
        own, texts | {f"far_msgs/msg/{name}": text for name, text in needed.items()}
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("int32 a\n", "---"),
        ("Inner a\n---\n", "expected the definition of far_msgs/msg/Inner in the text"),
        (full_text("Loop a\n---\n", Loop="Loop a\n"), "types that do not contain themselves"),
        (full_text("time a\n---\n"), "ROS 1"),
        (join_full_text("int32 a\n---\n", {"../../x": "int32 a\n"}), "expected a type name"),
    ],
)
def test_a_bad_text_from_a_server_is_one_error(text, problem):
    with pytest.raises(DefinitionError, match=problem):
        srvgen.define("far_msgs/srv/Ask", text)


def defined(number: int) -> type:
    text = srvgen.load("std_srvs/srv/Trigger")._DEFINITION
    event = text[text.index("\n" + "=" * 80) :]
    return srvgen.define("far_msgs/srv/Passing", f"int32 a {number}\n---\nint32 b\n{event}")


def test_classes_without_references_are_freed():
    kept = defined(0)
    given_up = [weakref.ref(defined(number)) for number in range(1, 20)]
    gc.collect()
    assert not any(ref() for ref in given_up)
    assert defined(0) is kept


def test_service_class_stays_the_same_while_a_message_of_it_exists():
    message = defined(77).Request()
    gc.collect()
    assert defined(77).Request is type(message)


def test_a_check_is_compiled_when_it_is_first_needed():
    """The first call and all others fail in the same line of the rendered source."""
    request = defined(5).Request
    lines = []
    for _ in range(2):
        with pytest.raises(srvgen.FieldError, match=r"^a: expected int32, got 'x'") as caught:
            request(a="x")._check()
        lines += [one.line for one in traceback.extract_tb(caught.value.__traceback__)[-3:-2]]
    assert lines == ['self.a = _runtime.to_int32(a_, "a")'] * 2
    assert request._check.__qualname__ == "Passing_Request._check"


def test_misspelt_type_name_gives_a_hint():
    with pytest.raises(DefinitionError) as caught:
        srvgen.load("std_srvs/srv/Triger")
    assert "Trigger" in caught.value.hint
    with pytest.raises(DefinitionError):
        srvgen.type_hash("nonsense")


def test_loaded_messages_are_pickled_by_name():
    add = srvgen.load("example_interfaces/srv/AddTwoInts")
    message = add.Request(a=3)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        assert pickle.loads(pickle.dumps(message, protocol)) == message


def test_a_traceback_shows_the_line_of_the_rendered_source():
    message = srvgen.load("nav_msgs/srv/GetPlan").Request(tolerance="far")
    try:
        message._check()
    except srvgen.FieldError as error:
        lines = traceback.format_exception(error)
    assert any('self.tolerance = _runtime.to_float32(self.tolerance, "tolerance")' in one
               for one in lines)  # fmt: skip


@pytest.mark.real_time
def test_threads_that_load_at_once_get_one_class(folder):
    put("many_msgs/srv/Ask", "geometry_msgs/Pose pose\n---\nint32 b\n", folder)
    start = threading.Barrier(8)
    found: list[object] = []

    def ask() -> None:
        start.wait()
        found.append(srvgen.load("many_msgs/srv/Ask"))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert len(set(found)) == 1


@pytest.mark.real_time
def test_importing_srvgen_loads_no_other_module():
    """A program with generated classes imports neither the parser nor msgspec."""
    code = (
        "import sys; before = set(sys.modules); import srvgen; "
        "print(*sorted(set(sys.modules) - before))"
    )
    root = Path(srvgen.__file__).parents[2]
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root
    ).stdout.split()
    assert "srvgen" in out
    assert not [name for name in out if name.startswith(("srvgen.", "msgspec", "typing"))]


def test_every_public_name_is_there():
    for name in srvgen.__all__:
        assert getattr(srvgen, name).__doc__
    assert set(srvgen.__all__) <= set(dir(srvgen))
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = srvgen.no_such_name


def test_every_bundled_interface_can_be_loaded():
    search = Search([BUNDLED])
    names = [name for package in search.packages() for name in search.interfaces(package)]
    assert len(names) > 150
    for name in names:
        loaded = srvgen.load(name)
        assert name == loaded._TYPE


def test_constants_and_defaults_can_be_read_everywhere_and_set_nowhere(folder):
    """Classes of rosidl behave so: their constants are properties of the metaclass."""
    put("demo_msgs/msg/Level", "int32 LOW=1\nint32 level 2\nint32 from 3\nstring NAME=x\n", folder)
    put("demo_msgs/msg/Plain", "int32 LOW=1\nint32[] levels [1, 2]\n", folder)
    for name in ("Level", "Plain"):
        cls = srvgen.load(f"demo_msgs/msg/{name}")
        assert cls.LOW == cls().LOW == 1
        default = f"{cls._FIELDS[0][0].upper()}__DEFAULT"
        for holder in (cls, cls()):
            for constant in ("LOW", default):
                with pytest.raises(AttributeError):
                    setattr(holder, constant, 5)
                with pytest.raises(AttributeError):
                    delattr(holder, constant)
        assert (cls.LOW, getattr(cls(), default)) == (1, getattr(cls, default))
    with pytest.raises(AttributeError, match=r"Level\.NAME is a constant and cannot be changed"):
        srvgen.load("demo_msgs/msg/Level").NAME = "y"


def test_messages_without_constants_have_the_metaclass_of_msgspec():
    """Another metaclass would make every message slower on Python 3.11."""
    assert type(srvgen.load("geometry_msgs/msg/Point")) is msgspec.StructMeta


def test_action_has_all_its_services_and_messages():
    impl = srvgen.load("example_interfaces/action/Fibonacci").Impl
    assert impl.CancelGoalService is srvgen.load("action_msgs/srv/CancelGoal")
    assert impl.GoalStatusMessage is srvgen.load("action_msgs/msg/GoalStatusArray")
    parts = (impl.SendGoalService, impl.GetResultService, impl.FeedbackMessage)
    assert [part._TYPE for part in parts] == [
        f"example_interfaces/action/Fibonacci_{name}"
        for name in ("SendGoal", "GetResult", "FeedbackMessage")
    ]


def test_type_that_several_types_need_is_built_once():
    """Without that, sixty messages of four fields each would never be finished."""
    last, separator = 60, "=" * 80
    event = srvgen.load("std_srvs/srv/Trigger")._DEFINITION
    nested = [
        f"{separator}\nMSG: ways_msgs/msg/M{n}\nM{n + 1}[] x\n"
        + (f"M{n + 2}[] y\n" if n + 2 <= last else "")
        for n in range(last)
    ]
    nested.append(f"{separator}\nMSG: ways_msgs/msg/M{last}\nint32 x\n")
    text = "M0 a\n---\n" + "".join(nested) + event[event.index(separator) :]
    made = srvgen.define("ways_msgs/srv/Ways", text)
    assert made.Request().a.x == []


def test_classes_have_strings_with_resolved_escapes(tmp_path, monkeypatch):
    folder = tmp_path / "escape_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Text.msg").write_text(
        r"""string one "tab\there"
string[] some ["a\x41", "C:\dir"]
string LINE="one\ntwo"
""",
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    made = srvgen.load("escape_msgs/msg/Text")
    assert made().one == "tab\there"
    assert made().some == ["aA", "C:\\dir"]
    assert made.LINE == "one\ntwo"


def test_text_in_a_program_may_use_the_bundled_packages():
    made = srvgen.define("mine/srv/Look", "geometry_msgs/Pose where\n---\nbool seen\n")
    assert made.Request().where.orientation.w == 1.0
    assert "service_msgs/msg/ServiceEventInfo" in made._DEFINITION
    assert srvgen.define("mine/srv/Look", made._DEFINITION)._HASH == made._HASH


def test_text_with_a_missing_dependency_is_refused():
    with pytest.raises(srvgen.DefinitionError, match="expected the definition of other/msg/X"):
        srvgen.define("mine/msg/Y", "other/X x\n")


@pytest.mark.parametrize(("one", "other"), [("0.0", "-0.0"), ("1.0", "2.0")])
def test_texts_whose_values_differ_have_classes_of_their_own(one, other):
    classes = [srvgen.define("mine/msg/Signed", f"float64 x {each}\n") for each in (one, other)]
    assert [repr(cls().x) for cls in classes] == [one, other]
    assert classes[0] is not classes[1]


def test_a_text_with_nan_has_one_class():
    text = "float64 x nan\n"
    first = srvgen.define("mine/msg/Nan", text)
    assert srvgen.define("mine/msg/Nan", text) is first


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        (None, "int32 a", "expected a type name (str), got None"),
        ("my_msgs/msg/A", None, "expected the text of my_msgs/msg/A (str), got None"),
        ("my_msgs/msg/A", b"int32 a", "expected the text of my_msgs/msg/A (str), got b'int32 a'"),
    ],
)
def test_wrong_argument_types_give_one_clear_message(name, text, problem):
    with pytest.raises(TypeError) as caught:
        srvgen.define(name, text)
    assert str(caught.value) == problem
