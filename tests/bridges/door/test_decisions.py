"""Each request is decided by the strictest rule that concerns it, and refused without one."""

import math

import pytest

import srvgen
from taskrpc.bridges.door import Outcome, parse_policy
from taskrpc.bridges.door.decisions import Counts, Moment, decide, permits

TEXT = """\
agents:
  may:
    - call /robot_task
    - call /robot_task/*
    - read /robot/pose
    - publish /cmd_vel
    - publish /poses
    - call /robot_task/_debug
  never:
    - call /robot_task/drop
    - publish /robot/*
  ask: {call /robot_task/stop: 30s, call /arm/open: 5s}
  dry_run: [call /robot_task/clear]
  limits:
    /robot_task:
      priority: 1..5
      target: [warehouse, dock]
      task_type: {length: ..6}
    /robot_task/*:
      speed: ..2
    /cmd_vel:
      linear.x: -0.2..0.2
    /poses:
      poses: {length: 1..2}
      poses.position.x: 0..1
  rate: {/robot_task: 2/min}
  when: {/cmd_vel: mon-fri 08:00..18:00}
students:
  may: [read /*]
"""
POLICY = parse_policy(TEXT)
MONDAY_NOON = Moment(0.0, 12 * 60)
TASK = {"task_type": "move", "target": "dock", "priority": 3}


def decided(verb, target, message=None, name="agents", moment=MONDAY_NOON):
    return decide(POLICY, name, verb, target, message, moment, Counts())[0]


@pytest.mark.parametrize(
    ("verb", "target", "message", "text"),
    [
        ("call", "/robot_task", TASK, "allowed by line 3 of the policy"),
        ("call", "/robot_task/list", {"speed": 2}, "allowed by line 4 of the policy"),
        ("call", "/robot_task/_debug", {"speed": 2}, "allowed by line 8 of the policy"),
        ("read", "/robot/pose", None, "allowed by line 5 of the policy"),
        ("publish", "/cmd_vel", {"linear": {"x": 0.2}}, "allowed by line 6 of the policy"),
        (
            "call",
            "/robot_task/stop",
            {"speed": 0},
            "needs approval within 30 s by line 12 of the policy",
        ),
        ("call", "/arm/open", None, "needs approval within 5 s by line 12 of the policy"),
        ("call", "/robot_task/clear", {"speed": 0}, "dry run by line 13 of the policy"),
    ],
)
def test_a_request_that_a_rule_permits_passes(verb, target, message, text):
    assert str(decided(verb, target, message)) == text


@pytest.mark.parametrize(
    ("verb", "target", "message", "line", "reason"),
    [
        ("call", "/robot", None, "agents:", "no rule lets agents call /robot"),
        ("read", "/robot_task", None, "agents:", "no rule lets agents read /robot_task"),
        ("publish", "/robot_task", TASK, "agents:", "no rule lets agents publish /robot_task"),
        (
            "call",
            "/robot_task/drop",
            {"speed": 1},
            "- call /robot_task/drop",
            "agents may never call /robot_task/drop",
        ),
        ("publish", "/robot/pose", None, "- publish /robot/*", "agents may never publish /robot/*"),
        (
            "call",
            "/robot_task/_hidden",
            None,
            "agents:",
            "no rule lets agents call /robot_task/_hidden",
        ),
        (
            "call",
            "/robot_task/set_parameters",
            None,
            "agents:",
            "no rule lets agents call /robot_task/set_parameters",
        ),
        ("Call", "/robot_task", TASK, "", "expected call, read, publish, got 'Call'"),
        ("call", "robot_task", TASK, "", "'robot_task': name must be absolute"),
        ("call", "/robot_task/", TASK, "", "'/robot_task/': name must not end with"),
        ("call", "//robot_task", TASK, "", "'//robot_task': name must not contain"),
        ("call", "", TASK, "", "'': name must not be empty"),
        ("call", "/robot_t\u0430sk", TASK, "", r"'/robot_t\u0430sk': name must not cont"),
        (
            "call",
            "/robot_task",
            {**TASK, "priority": 6},
            "priority: 1..5",
            "priority: expected 1 to 5, got 6",
        ),
        (
            "call",
            "/robot_task",
            {**TASK, "priority": "3"},
            "priority: 1..5",
            "priority: expected 1 to 5, got '3'",
        ),
        (
            "call",
            "/robot_task",
            {**TASK, "priority": math.nan},
            "priority: 1..5",
            "priority: expected 1 to 5, got nan",
        ),
        (
            "call",
            "/robot_task",
            {**TASK, "target": "d\u043eck"},
            "target: [warehouse, dock]",
            r"target: expected 'warehouse' or 'dock', got 'd\u043eck'",
        ),
        (
            "call",
            "/robot_task",
            {**TASK, "task_type": "deliver"},
            "task_type: {length: ..6}",
            "task_type: expected a length of at most 6, got 7",
        ),
        (
            "call",
            "/robot_task",
            {"target": "dock"},
            "priority: 1..5",
            "priority: expected this field, because it has a limit; the request has none",
        ),
        (
            "call",
            "/robot_task",
            {**TASK, "task_type": b"move"},
            "task_type: {length: ..6}",
            "task_type: expected an array or a text, got a value of type bytes",
        ),
        ("call", "/robot_task", None, "priority: 1..5", "priority: expected this field"),
        ("call", "/robot_task", ["move"], "priority: 1..5", "priority: expected this field"),
        ("call", "/robot_task", [], "priority: 1..5", "priority: expected this field"),
        ("call", "/robot_task/list", {}, "speed: ..2", "speed: expected this field"),
        (
            "publish",
            "/cmd_vel",
            {"linear": {"x": -0.3}},
            "linear.x: -0.2..0.2",
            "linear.x: expected -0.2 to 0.2, got",
        ),
        (
            "publish",
            "/cmd_vel",
            {"linear": 0.1},
            "linear.x: -0.2..0.2",
            "linear.x: expected this field",
        ),
        (
            "publish",
            "/cmd_vel",
            {"linear": [{"x": 0.1}, {"x": 9}]},
            "linear.x: -0.2..0.2",
            "linear[1].x: expected -0.2 to 0.2, got 9",
        ),
        (
            "publish",
            "/poses",
            {"poses": []},
            "poses: {length: 1..2}",
            "poses: expected a length of 1 to 2, got 0",
        ),
        (
            "publish",
            "/poses",
            {"poses": 3},
            "poses: {length: 1..2}",
            "poses: expected an array or a text, got 3",
        ),
        (
            "publish",
            "/poses",
            {"poses": [{"position": {"x": 0}}, {"position": {"x": 1.5}}]},
            "poses.position.x: 0..1",
            "poses[1].position.x: expected 0 to 1, got 1.5",
        ),
        (
            "publish",
            "/poses",
            {"poses": [[{"position": {"x": 9}}]]},
            "poses.position.x: 0..1",
            "poses[0].position.x: expected this field",
        ),
    ],
)
def test_a_request_beyond_a_rule_is_refused_with_its_line(verb, target, message, line, reason):
    decision = decided(verb, target, message)
    assert decision.outcome is Outcome.REFUSED
    lines = ["", *TEXT.splitlines()]
    assert lines[decision.line].strip() == line
    assert decision.reason.startswith(reason)


def test_an_unknown_name_may_do_nothing():
    decision = decided("read", "/robot/pose", name="Agents")
    assert str(decision) == "refused: the policy has no rules for 'Agents'"


def test_a_name_has_only_its_own_rules():
    assert decided("read", "/anything", name="students").outcome is Outcome.ALLOWED
    assert decided("call", "/robot_task", TASK, name="students").outcome is Outcome.REFUSED


@pytest.mark.parametrize(
    ("name", "verb", "target", "permitted"),
    [
        ("agents", "call", "/robot_task", True),
        ("agents", "call", "/robot_task/list", True),
        ("agents", "call", "/robot_task/stop", True),  # after an approval
        ("agents", "call", "/robot_task/clear", True),  # as a dry run
        ("agents", "call", "/robot_task/drop", False),
        ("agents", "call", "/robot_task/_hidden", False),
        ("agents", "call", "/other", False),
        ("agents", "read", "/robot_task", False),
        ("students", "read", "/robot/pose", True),
        ("nobody", "read", "/robot/pose", False),
    ],
)
def test_a_target_is_permitted_if_some_request_may_pass(name, verb, target, permitted):
    assert permits(POLICY, name, verb, target) == permitted


def test_never_wins_over_a_permission_of_the_same_name():
    policy = parse_policy("a: {may: [call /x], ask: [call /x], never: [call /*]}")
    decision, _ = decide(policy, "a", "call", "/x", None, MONDAY_NOON, Counts())
    assert str(decision) == "refused by line 1 of the policy: a may never call /*"


@pytest.mark.parametrize(
    ("rules", "outcome"),
    [
        ("may: [call /x], ask: [call /x]", Outcome.NEEDS_APPROVAL),
        ("may: [call /x], ask: [call /*]", Outcome.NEEDS_APPROVAL),
        ("may: [call /x], ask: [call /x], dry_run: [call /x]", Outcome.DRY_RUN),
        ("may: [call /*, call /x]", Outcome.ALLOWED),
    ],
)
def test_the_strictest_permission_decides(rules, outcome):
    policy = parse_policy(f"a: {{{rules}}}")
    decision, _ = decide(policy, "a", "call", "/x", None, MONDAY_NOON, Counts())
    assert decision.outcome is outcome


@pytest.mark.parametrize("target", ["/x/_hidden", "/x/set_parameters"])
@pytest.mark.parametrize(
    ("rule", "outcome"),
    [
        ("never: [call /x/*]", Outcome.REFUSED),
        ("ask: [call /x/*]", Outcome.NEEDS_APPROVAL),
        ("dry_run: [call /x/*]", Outcome.DRY_RUN),
        ("limits: {/x/*: {n: 1}}", Outcome.REFUSED),
        ("when: {/x/*: tue 08:00..18:00}", Outcome.REFUSED),
    ],
)
def test_a_pattern_that_restricts_includes_hidden_names(target, rule, outcome):
    policy = parse_policy(f"a: {{may: [call {target}], {rule}}}")
    decision, _ = decide(policy, "a", "call", target, None, MONDAY_NOON, Counts())
    assert decision.outcome is outcome


@pytest.mark.parametrize(("minute", "outcome"), [(479, "refused"), (480, "allowed")])
def test_a_target_with_times_is_refused_at_other_times(minute, outcome):
    moment = Moment(0.0, minute)
    decision = decided("publish", "/cmd_vel", {"linear": {"x": 0}}, moment=moment)
    assert decision.outcome.value == outcome
    if outcome == "refused":
        assert str(decision) == (
            "refused by line 27 of the policy: /cmd_vel is allowed only at these times:"
            " mon-fri 08:00..18:00"
        )


# Messages


def test_the_fields_of_message_objects_are_limited():
    twist = srvgen.load("geometry_msgs/msg/Twist")()
    assert decided("publish", "/cmd_vel", twist).outcome is Outcome.ALLOWED
    twist.linear.x = 0.25
    decision = decided("publish", "/cmd_vel", twist)
    assert decision.reason == "linear.x: expected -0.2 to 0.2, got 0.25"


def test_the_elements_of_arrays_in_message_objects_are_limited():
    poses = srvgen.load("geometry_msgs/msg/PoseArray")()
    pose = srvgen.load("geometry_msgs/msg/Pose")
    poses.poses = [pose(), pose()]
    assert decided("publish", "/poses", poses).outcome is Outcome.ALLOWED
    poses.poses[1].position.x = 1.5
    assert decided("publish", "/poses", poses).reason == (
        "poses[1].position.x: expected 0 to 1, got 1.5"
    )


def limited(definition, limits, **fields):
    cls = srvgen.define("door_test/msg/Limited", definition)
    policy = parse_policy(f"a: {{may: [publish /x], limits: {{/x: {{{limits}}}}}}}")
    decision, _ = decide(policy, "a", "publish", "/x", cls(**fields), MONDAY_NOON, Counts())
    return decision.reason


@pytest.mark.parametrize(
    ("definition", "limits", "fields", "reason"),
    [
        ("float32[] ranges", "ranges: 0..5", {"ranges": [1, 5]}, ""),
        ("float32[] ranges", "ranges: 0..5", {"ranges": [1, 6]}, "ranges[1]: expected 0 to 5, got"),
        ("float64 x", "x: 0..5", {"x": math.inf}, "x: expected 0 to 5, got inf"),
        ("uint8[] data", "data: {length: 2, each: 0..9}", {"data": b"\x01\x09"}, ""),
        (
            "uint8[] data",
            "data: {length: 2, each: 0..9}",
            {"data": b"\x01\x0a"},
            "data[1]: expected",
        ),
        ("byte b", "b: 0..9", {"b": 9}, ""),
        ("byte b", "b: 0..9", {"b": 10}, "b: expected 0 to 9, got 10"),
        ("byte[] b", "b: 0..9", {"b": [9, 10]}, "b[1]: expected 0 to 9, got 10"),
        ("bool go", "go: false", {"go": True}, "go: expected false, got true"),
        ("bool go", "go: 0..1", {"go": True}, "go: expected 0 to 1, got true"),
        ("string[] names", "names: [a, b]", {"names": ["a", "c"]}, "names[1]: expected 'a' or 'b'"),
        ("int32 lambda", "lambda: 0..1", {"lambda_": 2}, "lambda: expected 0 to 1, got 2"),
        ("int32 a", "b: 0..1", {}, "b: expected this field"),
        ("int32 priority 9", "priority: 1..5", {}, "priority: expected 1 to 5, got 9"),
    ],
)
def test_fields_of_each_type_are_limited(definition, limits, fields, reason):
    got = limited(definition, limits, **fields)
    assert got.startswith(reason) if reason else got == ""


# Rates


def calls(policy, *requests):
    """Return the outcomes of requests as (seconds, target), and the seconds to wait."""
    counts, found = Counts(), []
    for seconds, target in requests:
        moment = Moment(seconds, 0)
        decision, counts = decide(policy, "a", "call", target, None, moment, counts)
        found.append(decision.retry_after if decision.outcome is Outcome.REFUSED else "passed")
    return found


def test_a_rate_allows_no_more_in_any_period():
    policy = parse_policy("a: {may: [call /x], rate: {/x: 2/min}}")
    times = [0.0, 50.0, 59.0, 60.0, 61.0, 110.0]
    assert calls(policy, *((each, "/x") for each in times)) == [
        *("passed", "passed", 1.0, "passed", 49.0, "passed"),
    ]


def test_a_rate_of_a_pattern_counts_its_targets_together():
    policy = parse_policy("a: {may: [call /*], rate: {/x/*: 1/s, /x/b: 1/h}}")
    assert calls(policy, (0, "/x/a"), (0, "/x/b"), (0, "/y"), (1, "/x/b"), (2, "/x/a")) == [
        *("passed", 1.0, "passed", "passed", "passed"),
    ]


def test_a_request_that_is_refused_does_not_count():
    policy = parse_policy("a: {may: [call /x], rate: {/x: 1/min}, limits: {/x: {n: 1}}}")
    counts = Counts()
    for number, outcome in [(2, "refused"), (1, "allowed"), (1, "refused")]:
        message = {"n": number}
        decision, counts = decide(policy, "a", "call", "/x", message, MONDAY_NOON, counts)
        assert decision.outcome.value == outcome
    assert str(decision) == (
        "refused by line 1 of the policy: /x: at most 1/min; try again in 60.0 s"
    )


def test_names_are_counted_apart():
    policy = parse_policy(
        "a: {may: [call /x], rate: &r {/x: 1/min}}\nb: {may: [call /x], rate: *r}"
    )
    _, counts = decide(policy, "a", "call", "/x", None, MONDAY_NOON, Counts())
    decision, _ = decide(policy, "b", "call", "/x", None, MONDAY_NOON, counts)
    assert decision.outcome is Outcome.ALLOWED


def test_requests_that_need_approval_count():
    policy = parse_policy("a: {ask: [call /x], rate: {/x: 1/min}}")
    _, counts = decide(policy, "a", "call", "/x", None, MONDAY_NOON, Counts())
    decision, _ = decide(policy, "a", "call", "/x", None, MONDAY_NOON, counts)
    assert decision.outcome is Outcome.REFUSED
