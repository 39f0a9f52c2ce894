"""Messages are converted to plain values and back; an error has the path of the value."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from srvgen import FieldError, from_builtins, to_builtins

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
GetPlan = srvgen.load("nav_msgs/srv/GetPlan")
Status = srvgen.load("diagnostic_msgs/msg/DiagnosticStatus")
Scan = srvgen.load("sensor_msgs/msg/LaserScan")
Arrays = srvgen.load("test_msgs/msg/Arrays")


def problem_of(cls: type, obj: object) -> str:
    with pytest.raises(FieldError) as caught:
        from_builtins(cls, obj)
    return str(caught.value)


def test_a_message_becomes_plain_values_and_comes_back():
    plan = GetPlan.Response()
    plan.plan.poses = [srvgen.load("geometry_msgs/msg/PoseStamped")()]
    plan.plan.poses[0].pose.position.x = 1
    plain = to_builtins(plan)
    assert json.loads(json.dumps(plain)) == plain
    assert plain["plan"]["poses"][0]["pose"]["position"] == {"x": 1.0, "y": 0.0, "z": 0.0}
    assert from_builtins(GetPlan.Response, plain) == plan


def test_arrays_are_lists_and_a_byte_is_a_number():
    assert to_builtins(Scan(ranges=[1, 2]))["ranges"] == [1.0, 2.0]
    assert to_builtins(Status(level=Status.WARN))["level"] == 1
    assert to_builtins(Arrays())["byte_values_default"] == [0, 1, 255]
    assert from_builtins(Status, {"level": 2}).level == b"\x02"


def test_every_value_is_of_an_exact_builtin_type():
    def types(value: object) -> set[type]:
        if isinstance(value, dict):
            return {dict}.union(*map(types, value.values()))
        if isinstance(value, list):
            return {list}.union(*map(types, value))
        return {type(value)}

    assert types(to_builtins(Arrays())) <= {dict, list, int, float, str, bool}


def test_non_finite_numbers_stay_numbers():
    values = to_builtins(Scan(ranges=[math.inf, -math.inf]))["ranges"]
    assert values == [math.inf, -math.inf]


def test_missing_fields_keep_their_defaults():
    assert from_builtins(AddTwoInts.Request, {"b": 2}) == AddTwoInts.Request(a=0, b=2)
    assert from_builtins(GetPlan.Request, {}).goal.pose.orientation.w == 1.0


def test_messages_are_accepted_in_place_of_dicts():
    pose = srvgen.load("geometry_msgs/msg/PoseStamped")()
    assert from_builtins(GetPlan.Request, {"goal": pose}).goal == pose


@pytest.mark.parametrize(
    ("cls", "obj", "problem"),
    [
        (AddTwoInts.Request, {"c": 1}, "c: unknown field 'c'; AddTwoInts_Request has a, b"),
        (Scan, {"rangs": []}, "rangs: unknown field 'rangs'; LaserScan has header, angle_min"),
        (GetPlan.Request, {"goal": {"pose": {"position": {"x": "1"}}}},
         "goal.pose.position.x: expected float64, got '1' (str)"),
        (GetPlan.Request, {"goal": {"pose": {"positon": {}}}}, "goal.pose.positon: unknown field"),
        (GetPlan.Response, {"plan": {"poses": [{}, {"pose": 3}]}},
         "plan.poses[1].pose: expected the fields of geometry_msgs/msg/Pose (position, orient"),
        (GetPlan.Response, {"plan": {"poses": {}}}, "plan.poses: expected a list, got {} (dict)"),
        (AddTwoInts.Request, [1, 2], "expected the fields of example_interfaces/srv/AddTwoInts_"),
        (AddTwoInts.Request, {"a": None}, "a: expected int64, got None"),
        (AddTwoInts.Request, {1: 2}, "1: unknown field 1; AddTwoInts_Request has a, b"),
        (srvgen.load("std_srvs/srv/Trigger").Request, {"a": 1},
         "a: unknown field 'a'; Trigger_Request has no fields"),
    ],
)  # fmt: skip
def test_an_error_names_the_path(cls, obj, problem):
    assert problem_of(cls, obj).startswith(problem)


def test_misspelt_field_gives_a_suggestion():
    assert problem_of(Scan, {"rangs": []}).endswith("; did you mean 'ranges'?")


def test_an_invalid_message_is_not_converted():
    with pytest.raises(FieldError, match=r"^a: expected int64, got 'x'"):
        to_builtins(AddTwoInts.Request(a="x"))


def test_keyword_fields_have_their_ros_names(tmp_path):
    text = "int32 from\n---\n"
    cls = srvgen.define("demo_msgs/srv/Ask", text + _event_texts()).Request
    assert to_builtins(cls(from_=3)) == {"from": 3}
    assert from_builtins(cls, {"from": 4}) == cls(from_=4)
    assert problem_of(cls, {"from_": 4}).startswith("from_: unknown field 'from_'")


def _event_texts() -> str:
    text: str = AddTwoInts._DEFINITION
    return text[text.index("\n" + "=" * 80) :]


@given(st.integers(), st.integers())
def test_any_integer_is_converted_or_refused(a, b):
    low, high = -(2**63), 2**63 - 1
    wrong = [name for name, value in (("a", a), ("b", b)) if not low <= value <= high]
    if wrong:
        assert problem_of(AddTwoInts.Request, {"a": a, "b": b}).startswith(f"{wrong[0]}: ")
    else:
        message = from_builtins(AddTwoInts.Request, {"a": a, "b": b})
        assert to_builtins(message) == {"a": a, "b": b}


@pytest.mark.parametrize("wrong", [3, None, {"a": 1}, AddTwoInts, AddTwoInts.Request])
@pytest.mark.parametrize("convert", [srvgen.to_builtins, srvgen.to_cdr])
def test_value_that_is_not_a_message_is_a_type_error(convert, wrong):
    problem = r"^expected a message, such as AddTwoInts\.Request\(\), got "
    with pytest.raises(TypeError, match=problem):
        convert(wrong)


@pytest.mark.parametrize("wrong", [3, None, int, AddTwoInts, AddTwoInts.Request()])
def test_wrong_class_is_a_type_error(wrong):
    problem = r"^expected a message class, such as AddTwoInts\.Request, got "
    with pytest.raises(TypeError, match=problem):
        srvgen.from_builtins(wrong, {})
