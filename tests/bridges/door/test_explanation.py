"""What a name may do, in plain words."""

from taskrpc.bridges.door import parse_policy
from taskrpc.bridges.door.explanation import explain


def explained(text):
    [(name, rules)] = parse_policy(text).names.items()
    return "\n".join(explain(name, rules))


def test_each_permission_has_its_conditions():
    text = """\
agents:
  may: [call /robot_task, read /robot/pose, call /arm/*]
  never: [call /arm/drop]
  limits:
    /robot_task: {priority: 1..5, target: [dock, central], names: {length: ..3, each: a}}
    /arm/open: {speed: ..0.5}
  rate: {/robot_task: 6/min, /robot/*: 1/s}
  ask: [call /robot_task/stop]
  dry_run: [call /robot_task/clear]
  when: {/robot_task: mon-fri 08:00..18:00}
"""
    assert (
        explained(text)
        == """\
agents (line 1)
  may try to call /robot_task/clear: the door only says what it would do
  may call /robot_task/stop after a person has approved it within 60 s
  may call /robot_task
    priority: 1 to 5
    target: 'dock' or 'central'
    names: 'a', length at most 3
    at most 6/min
    only at mon-fri 08:00..18:00
  may read /robot/pose
    /robot/*: at most 1/s
  may call /arm/*, except hidden names and the services that every node has
    /arm/open: speed: at most 0.5
  may never call /arm/drop
  may do nothing else"""
    )


def test_a_name_without_rules_may_do_nothing():
    assert explained("students: {}") == "students (line 1)\n  may do nothing"


def test_rules_without_effect_are_noted():
    text = """\
a:
  may: [call /x/y, read /pose]
  never: [call /x/*]
  limits: {/pose: {x: 1}}
  rate: {/z: 1/s}
"""
    assert (
        explained(text)
        == """\
a (line 1)
  may read /pose
  may never call /x/*
  may do nothing else
  note: line 2 has no effect: a may never call /x/y
  note: line 4 has no effect: no rule lets a call or publish /pose
  note: line 5 has no effect: no rule lets a call or read or publish /z"""
    )


def test_a_stricter_rule_hides_what_it_replaces():
    text = "a: {may: [call /x], ask: [call /x]}"
    assert explained(text) == (
        "a (line 1)\n  may call /x after a person has approved it within 60 s\n"
        "  may do nothing else"
    )
