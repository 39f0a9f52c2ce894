"""No request passes that a naive reading of the file refuses.

The naive reading is a second implementation, without any code of the first: plain dicts from the
YAML file, and the obvious comparison for each rule.
"""

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.bridges.door import Door, Outcome, parse_policy
from taskrpc.bridges.door.decisions import Counts, Moment, decide
from taskrpc.node import Node
from tests.properties import examples

NAMESPACE, NODE = "/lab", "robot_task"
DAYS = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"]


# The naive reading


def refuses(rules, verb, target, message, seconds, minute, passed):
    """Whether a reader of the rules would refuse; `passed` has what passed, as (time, target)."""
    listed = {key: [each.split() for each in rules.get(key, ())] for key in ("may", "ask", "never")}
    may, ask, never = (
        any(v == verb and covers(t, target) for v, t in each) for each in listed.values()
    )
    limits, rates, hours = (
        [value for pattern, value in rules.get(key, {}).items() if covers(pattern, target)]
        for key in ("limits", "rate", "when")
    )
    begun = [each for each in rules.get("rate", {}) if covers(each, target)]
    return (
        never
        or not (may or ask)
        or (verb != "read" and any(not fits(message, each) for each in limits))
        or any(not is_open(each, minute) for each in hours)
        or any(
            sum(covers(pattern, t) and seconds - s < 60 for s, t in passed) >= int(rate[:-4])
            for pattern, rate in zip(begun, rates, strict=True)
        )
    )


def covers(pattern, target):
    return pattern == target or (pattern[-1] == "*" and target.startswith(pattern[:-1]))


def fits(message, limits):
    return all(
        within(value, limit)
        for path, limit in limits.items()
        for value in ends(message, path.split("."))
    )


def ends(value, path):
    if path and isinstance(value, list):
        return [end for each in value for end in ends(each, path)]
    if not path:
        return [value]
    return ends(value.get(path[0]) if isinstance(value, dict) else None, path[1:])


def within(value, limit):
    if isinstance(limit, dict):
        length = len(value) if isinstance(value, list | str) else math.nan
        right = "length" not in limit or within(length, limit["length"])
        return right and ("each" not in limit or within(value, limit["each"]))
    if isinstance(value, list):
        return all(within(each, limit) for each in value)
    value = value[0] if isinstance(value, bytes) and len(value) == 1 else value
    if isinstance(limit, str) and ".." in limit:
        low, high = limit.split("..")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and float(low or "-inf") <= value <= float(high or "inf")
    allowed = limit if isinstance(limit, list) else [limit]
    return any(
        value == each and isinstance(value, bool) == isinstance(each, bool) for each in allowed
    )


def is_open(window, minute):
    days, times = window.split()
    begin, end = times.split("..")
    first, last = (DAYS.index(each) for each in days.split("-"))
    day, now = divmod(minute, 1440)
    clock = f"{now // 60:02}:{now % 60:02}"
    if begin < end:
        return first <= day <= last and begin <= clock < end
    late = first <= day <= last and clock >= begin
    return late or (first <= (day - 1) % 7 <= last and clock < end)


# Random policies and requests

TARGETS = ["/robot_task", "/robot_task/stop", "/robot_task/_hidden", "/lab/arm", "/lab/robot_task"]
PATTERNS = [*TARGETS, "/*", "/robot_task/*", "/lab/*"]
FIELDS = ["priority", "linear.x", "poses.x", "names"]
RANGES = ["1..5", "..5", "1..", "-0.2..0.2", "0..0"]
LISTS = [["dock", "central"], ["dock", 1], [True], [0.2, "5"], "dock", 5]
VALUES = [
    *(0, 1, 5, 6, -1, 0.2, 0.21, -0.0, 10**400, math.nan, math.inf, True, False, None, 1e-320),
    *("dock", "d\u043eck", "5", "", b"\x05", b"\x06", b"dock", [1], []),
]
verbs = st.sampled_from(["call", "read", "publish"])
rules = st.lists(st.builds("{} {}".format, verbs, st.sampled_from(PATTERNS)), max_size=3)
bounds = st.sampled_from([*RANGES, *LISTS])
lengths = st.sampled_from(["0..2", "..1", 2])
limit = (
    bounds
    | st.fixed_dictionaries({"length": lengths}, optional={"each": bounds})
    | st.fixed_dictionaries({"each": bounds})
)
limits = st.dictionaries(st.sampled_from(FIELDS), limit, max_size=2)
windows = st.sampled_from(["mon-fri 08:00..18:00", "tue-tue 22:00..06:00", "mon-sun 00:00..24:00"])
wide = st.lists(st.sampled_from(["call /*", "publish /*", "read /lab/*"]), min_size=1, max_size=3)


def by_target(values):
    return st.dictionaries(st.sampled_from(PATTERNS), values, max_size=2)


policies = st.fixed_dictionaries(
    {"may": rules | st.builds(list.__add__, rules, wide)},
    optional={
        "ask": rules,
        "never": rules,
        "limits": by_target(limits),
        "rate": by_target(st.sampled_from(["1/min", "2/min"])),
        "when": by_target(windows),
    },
)
values = st.sampled_from([0, 1, 5, "dock"]) | st.sampled_from(VALUES)
items = values | st.lists(values, max_size=3)
points = st.fixed_dictionaries({"x": items})
fields = {
    "priority": items,
    "linear": points | items,
    "poses": st.lists(points, max_size=3) | items,
    "names": items,
}
messages = st.fixed_dictionaries(fields) | st.fixed_dictionaries({}, optional=fields)


def spellings(target):
    """Every way in which a node `/lab/robot_task` may write a name, right or wrong."""
    own = f"{NAMESPACE}/{NODE}"
    found = [target, target, f"/{target}", f"{target}/", target.replace("/", "//")]
    found += [f"{{ns}}/..{target}", f" {target}", target.replace("o", "\u043e"), f"{target}\n"]
    if target.startswith(f"{NAMESPACE}/"):
        found += [target.removeprefix(f"{NAMESPACE}/"), target.replace(NAMESPACE, "{ns}", 1)]
        found += [target.replace(NAMESPACE, "/{namespace}", 1), target.replace(NODE, "{node}")]
    if target.startswith(own):
        found.append(target.replace(own, "~", 1))
    other = target.upper()  # names are case-sensitive: this is another service
    return [*((each, target) for each in found), (other, other)]


requests = st.tuples(
    verbs,
    st.sampled_from(TARGETS).map(lambda target: (target, target))
    | st.sampled_from([each for target in TARGETS for each in spellings(target)]),
    messages,
    st.floats(0.0, 40.0),
    st.integers(0, 7 * 1440 - 1) | st.integers(480, 500),
)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("door") / "door.yaml"


async def tried(path, rules, sent):
    """Send requests through a door; return how many passed. Fails at one that should not pass."""
    path.write_text(yaml.safe_dump({"agents": rules}, allow_unicode=True), encoding="utf-8")
    path.chmod(0o600)
    moment, passed = Moment(0.0, 0), []
    async with Node(NODE, namespace=NAMESPACE) as node:
        door = Door(path, node, now=lambda: moment)
        for verb, (spelling, target), message, wait, minute in sent:
            moment = Moment(moment.seconds + wait, minute)
            decision = door.decide("agents", verb, spelling, message)
            if decision.outcome is not Outcome.REFUSED:
                facts = (verb, target, message, moment.seconds, minute, passed)
                assert not refuses(rules, *facts), (spelling, decision)
                passed.append((moment.seconds, target))
    return len(passed)


@settings(max_examples=examples(500))
@given(policies, st.lists(requests, min_size=1, max_size=8))
async def test_no_request_passes_that_a_naive_reading_refuses(path, rules, sent):
    await tried(path, rules, sent)


@settings(max_examples=examples(2000))
@given(limit, items)
def test_no_value_passes_that_a_naive_reading_of_its_limit_refuses(limit, value):
    rules = {"may": ["call /x"], "limits": {"/x": {"field": limit}}}
    policy = parse_policy(yaml.safe_dump({"a": rules}))
    message = {"field": value}
    decision, _ = decide(policy, "a", "call", "/x", message, Moment(0.0, 0), Counts())
    assert decision.outcome is Outcome.REFUSED or within(value, limit)
