"""A policy is read as it is written, and each mistake shows its line and what to do."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.bridges.door import PolicyError, parse_policy
from taskrpc.bridges.door.policy import Limit, Range, Rate, Rule, Values
from taskrpc.bridges.door.policy_file import APPROVAL_TIMEOUT, Known

GOOD = """\
# who may do what
agents:
  may: [call /robot_task, read /robot/*, "publish /cmd_vel"]
  never: [call /robot_task/drop]
  limits:
    /robot_task: {priority: 1..5, target: [warehouse, dock], note: {length: ..20}}
    /cmd_vel:
      linear.x: -0.2..0.2
      flags: {length: 3, each: [true, 1, "1"]}
  rate: {/robot_task: 6/min}
  ask: {call /robot_task/stop: 30s, call /robot_task/pause: 2 min}
  dry_run: [call /arm/grasp]
  when: {/robot_task: [mon-fri 08:00..18:00, 22:00..06:00], /cmd_vel: sat 10:00..24:00}
students: {}
"""


def test_a_policy_is_read_as_it_is_written():
    policy = parse_policy(GOOD)
    assert list(policy.names) == ["agents", "students"]
    rules = policy.names["agents"]
    assert rules.may == (
        Rule("call", "/robot_task", 3),
        Rule("read", "/robot/*", 3),
        Rule("publish", "/cmd_vel", 3),
    )
    assert rules.never == (Rule("call", "/robot_task/drop", 4),)
    task, velocity = rules.limits
    assert task.limits == (
        Limit(("priority",), 6, Range(1, 5)),
        Limit(("target",), 6, Values(("warehouse", "dock"))),
        Limit(("note",), 6, None, Range(None, 20)),
    )
    assert velocity.limits == (
        Limit(("linear", "x"), 8, Range(-0.2, 0.2)),
        Limit(("flags",), 9, Values((True, 1, "1")), Range(3, 3)),
    )
    assert rules.rate == (Rate("/robot_task", 6, 60.0, "6/min", 10),)
    assert [(each.target, each.timeout) for each in rules.ask] == [
        ("/robot_task/stop", 30.0),
        ("/robot_task/pause", 120.0),
    ]
    assert rules.dry_run == (Rule("call", "/arm/grasp", 12),)
    assert [str(each) for each in rules.when] == [
        "mon-fri 08:00..18:00 and 22:00..06:00",
        "sat 10:00..24:00",
    ]


def test_a_list_of_approvals_has_the_default_timeout():
    policy = parse_policy("a: {ask: [call /x]}")
    assert policy.names["a"].ask[0].timeout == APPROVAL_TIMEOUT


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5", 5),
        ("-0.25", -0.25),
        ("1e3", 1000.0),
        ('"5"', "5"),
        ("true", True),
        ('"1..5"', "1..5"),
        ("dock", "dock"),
        ("007", 7),
        ("'yes'", "yes"),
    ],
)
def test_a_single_value_is_a_number_only_without_quotes(text, value):
    limit = parse_policy(f"a: {{limits: {{/x: {{f: {text}}}}}}}").names["a"].limits[0].limits[0]
    assert limit.values == Values((value,))
    assert type(limit.values.values[0]) is type(value)


def rules(text):
    return f"agents:\n  {text}\n"


MISTAKES = {
    "empty": ("", "door.yaml: error: the policy is empty"),
    "no names": ("- call /x", "1:1: error: a policy: expected entries as `name: value`"),
    "wrong name": (
        "a b: {}",
        "1:1: error: an account's name: expected 1 to 64 letters",
    ),
    "rule": (rules("mya: []"), "2:3: error: agents has no 'mya' (did you mean 'may'?): expected"),
    "no list": (rules("may: call /x"), "2:8: error: may: expected a list, got 'call /x'"),
    "no verb": (
        rules("may: [/x]"),
        "2:9: error: may: expected a verb and a name such as `call /robot_task`, got '/x'",
    ),
    "entry": (rules("may: [call: /x]"), "2:9: error: may: expected a verb and a name such as"),
    "verb": (
        rules("never: [cal /x]"),
        "2:11: error: never: expected call, read or publish before the name, got 'cal';"
        " did you mean call?",
    ),
    "relative": (
        rules("may: [call robot_task]"),
        "2:14: error: expected an absolute name, because a policy belongs to no node:"
        " write /robot_task",
    ),
    "no target": (rules("may: ['call ']"), "2:15: error: expected an absolute name"),
    "slashes": (rules("may: [call /a//b]"), "2:17: error: '/a//b': name must not contain rep"),
    "end": (rules("may: [call /a/]"), "2:16: error: '/a/': name must not end with a '/'"),
    "character": (rules('may: ["call /a-b"]'), "2:17: error: '/a-b': name must not contain char"),
    "pattern": (
        rules("may: [call /a*]"),
        "2:16: error: expected * only as the last part of a name, such as /robot_task/*; got",
    ),
    "pattern twice": (rules("may: [call /*/*]"), "2:15: error: expected * only as the last part"),
    "target twice": (rules("rate: {/a: 1/s, /a: 2/s}"), "2:19: error: rate: '/a' appears twice"),
    "field": (rules("limits: {/x: {a..b: 1}}"), "2:17: error: expected a field such as priority"),
    "brackets": (
        rules('limits: {/x: {"poses[].x": 1}}'),
        "2:23: error: write poses.x without brackets: a limit holds for each element",
    ),
    "reversed": (
        rules("limits: {/x: {a: 5..1}}"),
        "2:20: error: no number lies in the range 5..1: write 1..5",
    ),
    "range": (rules("limits: {/x: {a: 0...5}}"), "2:20: error: expected a range such as 1..5,"),
    "no range": (rules("limits: {/x: {a: ..}}"), "2:20: error: expected a range such as 1..5,"),
    "nan": (rules("limits: {/x: {a: .nan}}"), "2:20: error: expected a number such as 5 or 0.2"),
    "infinite": (rules("limits: {/x: {a: 1..1e999}}"), "2:20: error: expected a number that a"),
    "yes": (rules("limits: {/x: {a: yes}}"), "2:20: error: expected a number such as 5 or 0.2"),
    "date": (rules("limits: {/x: {a: 2026-01-01}}"), "2:20: error: expected a number such as 5"),
    "nothing": (rules("limits: {/x: {a: }}"), "2:19: error: expected a number such as 5 or 0.2"),
    "no values": (rules("limits: {/x: {a: []}}"), "2:20: error: expected at least one value"),
    "range in list": (rules("limits: {/x: {a: [1..2]}}"), "2:21: error: a range stands alone"),
    "nested": (rules("limits: {/x: {a: {x: 1}}}"), "2:21: error: a has no 'x': expected length,"),
    "no length": (rules("limits: {/x: {a: {}}}"), "2:20: error: a: expected length, each or both"),
    "length": (rules("limits: {/x: {a: {length: b}}}"), "2:29: error: expected a length such as"),
    "rate": (
        rules("rate: {/x: 6/minute}"),
        "2:14: error: expected a rate such as 6/min (s, min, h or day); got '6/minute'",
    ),
    "no rate": (rules("rate: {/x: 0/s}"), "2:14: error: expected a rate such as 6/min"),
    "large rate": (rules("rate: {/x: 1001/s}"), "2:14: error: expected at most 1000 requests"),
    "timeout": (rules("ask: {call /x: 30}"), "2:18: error: expected a time for the approval such"),
    "long timeout": (rules("ask: {call /x: 25h}"), "2:18: error: expected a time for the approval"),
    "times": (rules("when: {/x: mon 8..18}"), "2:14: error: expected times such as mon-fri 08:00"),
    "minute": (rules("when: {/x: 24:01..25:00}"), "2:14: error: expected times such as mon-fri"),
    "no time": (rules("when: {/x: 08:00..08:00}"), "2:14: error: expected times such as mon-fri"),
    "no times": (rules("when: {/x: []}"), "2:14: error: expected times such as mon-fri"),
    "not YAML": ("agents: [", "error: not valid YAML: expected the node content"),
}


@pytest.mark.parametrize(("text", "error"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_shown_at_its_place(text, error):
    with pytest.raises(PolicyError) as caught:
        parse_policy(text, "door.yaml")
    assert error in str(caught.value)


def test_a_caret_points_at_the_wrong_part():
    with pytest.raises(PolicyError) as caught:
        parse_policy(rules('may: ["call /a-b"]'), "door.yaml")
    _, line, caret = str(caught.value).splitlines()
    assert line[caret.index("^")] == "-"


@pytest.mark.parametrize(
    ("rule", "error"),
    [
        ("may: [call /robot_tusk]", "2:14: error: no running program has /robot_tusk; did you mea"),
        ("may: [read /robot_task]", "2:14: error: no running program has /robot_task"),
        ("may: [call /arm/*]", "2:14: error: no running program has /arm/*"),
        ("rate: {/pos: 1/s}", "2:10: error: no running program has /pos; did you mean /pose?"),
    ],
)
def test_unknown_names_are_mistakes_if_the_running_programs_are_known(rule, error):
    known = Known(["/robot_task", "/robot_task/run/_action/send_goal"], ["/pose"])
    with pytest.raises(PolicyError) as caught:
        parse_policy(rules(rule), "door.yaml", known)
    assert error in str(caught.value)


def test_known_names_are_no_mistakes():
    known = Known(["/robot_task", "/robot_task/run/_action/send_goal"], ["/pose"])
    text = "may: [call /robot_task, call /robot_task/run, call /robot_task/*, read /*, read /pose]"
    assert len(parse_policy(rules(text), "door.yaml", known).names["agents"].may) == 5


@given(st.integers(0, len(GOOD)), st.integers(0, 5), st.text(max_size=5))
def test_every_text_gives_a_policy_or_a_mistake(at, count, new):
    with contextlib.suppress(PolicyError):
        parse_policy(GOOD[:at] + new + GOOD[at + count :])


def test_a_number_of_any_length_is_read_or_refused():
    with pytest.raises(PolicyError, match="expected a number that a float64 can hold, got 000"):
        parse_policy(rules(f"limits: {{/x: {{a: {'0' * 5000}1}}}}"))
