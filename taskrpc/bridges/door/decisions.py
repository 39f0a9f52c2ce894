"""Decides one request by a policy. Pure: the time and the earlier requests are passed in.

Everything is refused that no rule permits. `never` wins over all other rules; after it come
`dry_run`, `ask` and `may`. Limits, rates and hours hold for all of them.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import lru_cache
from typing import Any

import msgspec

from taskrpc.bridges.door.policy import (
    VERBS,
    Limit,
    Policy,
    Range,
    Rate,
    Rules,
    Values,
    matches,
    shown,
)
from taskrpc.errors import InvalidName
from taskrpc.spi import names

_ARRAYS = (list, tuple, array)
_SIZED = (str, *_ARRAYS)
_MISSING = object()
"""The value of a field that a message does not have."""
_KEPT = 1024
"""Names that are remembered as valid, and message classes with their fields."""


class Outcome(Enum):
    """What a door does with a request."""

    ALLOWED = "allowed"
    REFUSED = "refused"
    NEEDS_APPROVAL = "needs approval"
    DRY_RUN = "dry run"
    """The door says what it would do, and passes nothing on."""


class Decision(msgspec.Struct, frozen=True):
    """What a door does with a request, and the rule for it."""

    outcome: Outcome
    line: int = 0
    """The line of the rule in the policy; 0 if there is none."""
    reason: str = ""
    """Why the request is refused: what was expected and what came; "" if it is not refused."""
    timeout: float = 0.0
    """Seconds that a person has for the approval."""
    retry_after: float = 0.0
    """Seconds after which a request that came too soon may be repeated."""

    def __str__(self) -> str:
        text = self.outcome.value
        if self.outcome is Outcome.NEEDS_APPROVAL:
            text += f" within {self.timeout:g} s"
        if self.line:
            text += f" by line {self.line} of the policy"
        return f"{text}: {self.reason}" if self.reason else text


class Moment(msgspec.Struct, frozen=True):
    """A time, on the two clocks that rules need."""

    seconds: float
    """Seconds on a clock that never goes back."""
    minute: int
    """The minute of the week in local time, counted from Monday 0:00."""


class Counts(msgspec.Struct, frozen=True):
    """The times of the earlier requests: the latest ones, by the name and target of a rate."""

    times: Mapping[tuple[str, str], tuple[float, ...]] = {}


def refused(reason: str, line: int = 0, retry_after: float = 0.0) -> Decision:
    """Return a refusal."""
    return Decision(Outcome.REFUSED, line, reason, retry_after=retry_after)


def decide(
    policy: Policy,
    name: str,
    verb: str,
    target: str,
    message: object,
    moment: Moment,
    counts: Counts,
) -> tuple[Decision, Counts]:
    """Decide whether `name` may do this now; return the decision, and the counts after it.

    `target` is an absolute name. `message` is the message that is passed on, with its defaults: a
    message object or a mapping; None if there is none. Refused requests do not count for rates.
    """
    rules = policy.names.get(name)
    if rules is None:
        return refused(f"the policy has no rules for {shown(name)}"), counts
    if verb not in VERBS:
        return refused(f"expected {', '.join(VERBS)}, got {shown(verb)}"), counts
    try:
        _check_absolute(target)
    except InvalidName as error:
        return refused(f"{shown(target)}: {error.problem}"), counts
    refusal = _rule_refusal(rules, name, verb, target, moment)
    if refusal is None and verb != "read":
        refusal = _limit_refusal(rules, target, message)
    if refusal is None:
        refusal, counts = _counted(rules, name, target, moment.seconds, counts)
    return refusal or _permission(rules, verb, target), counts


def permits(policy: Policy, name: str, verb: str, target: str) -> bool:
    """Return whether some request of this kind may pass; limits, rates and hours do not count.

    `target` is an absolute name.
    """
    rules = policy.names.get(name)
    if rules is None or any(rule.concerns(verb, target) for rule in rules.never):
        return False
    return any(rule.permits(verb, target) for rule in (*rules.may, *rules.ask, *rules.dry_run))


@lru_cache(_KEPT)
def _check_absolute(target: str) -> None:
    names.check_absolute(target, "name")


def _rule_refusal(
    rules: Rules, name: str, verb: str, target: str, moment: Moment
) -> Decision | None:
    for rule in rules.never:
        if rule.concerns(verb, target):
            return refused(f"{name} may never {rule}", rule.line)
    permitting = (*rules.may, *rules.ask, *rules.dry_run)
    if not any(rule.permits(verb, target) for rule in permitting):
        return refused(f"no rule lets {name} {verb} {target}", rules.line)
    for hours in rules.when:
        is_open = any(window.has(moment.minute) for window in hours.windows)
        if matches(hours.target, target) and not is_open:
            return refused(f"{hours.target} is allowed only at these times: {hours}", hours.line)
    return None


def _permission(rules: Rules, verb: str, target: str) -> Decision:
    """Return how a request passes; the strictest rule that concerns it decides."""
    for outcome, listed in ((Outcome.DRY_RUN, rules.dry_run), (Outcome.NEEDS_APPROVAL, rules.ask)):
        for rule in listed:
            if rule.concerns(verb, target):
                return Decision(outcome, rule.line, timeout=rule.timeout)
    line = next(rule.line for rule in rules.may if rule.permits(verb, target))
    return Decision(Outcome.ALLOWED, line)


# Limits


def _limit_refusal(rules: Rules, target: str, message: object) -> Decision | None:
    for limits in rules.limits:
        if matches(limits.target, target):
            for limit in limits.limits:
                for problem in _problems(limit, message):
                    return refused(problem, limit.line)
    return None


def _problems(limit: Limit, message: object) -> Iterator[str]:
    whole = _MISSING if isinstance(message, _ARRAYS) else message
    for where, value in _found(whole, limit.path, ""):
        if value is _MISSING:
            yield f"{where}: expected this field, because it has a limit; the request has none"
            continue
        if limit.length is not None:
            yield from _length_problems(where, value, limit.length)
        if limit.values is not None:
            yield from _value_problems(where, value, limit.values)


def _length_problems(where: str, value: object, length: Range) -> Iterator[str]:
    if not isinstance(value, _SIZED):
        yield f"{where}: expected an array or a text, got {shown(value)}"
    elif not length.allows(len(value)):
        yield f"{where}: expected a length of {length}, got {len(value)}"


def _value_problems(where: str, value: object, allowed: Range | Values) -> Iterator[str]:
    if isinstance(value, _ARRAYS):
        for index, each in enumerate(value):
            if not allowed.allows(_plain(each)):
                yield f"{where}[{index}]: expected {allowed}, got {shown(_plain(each))}"
    elif not allowed.allows(_plain(value)):
        yield f"{where}: expected {allowed}, got {shown(_plain(value))}"


def _plain(value: object) -> object:
    """Return the number of a field of type byte, which has bytes of length 1."""
    return value[0] if isinstance(value, bytes) and len(value) == 1 else value


def _found(value: object, path: tuple[str, ...], where: str) -> Iterator[tuple[str, object]]:
    """Return the values at the end of a path; it goes through each element of an array."""
    if not path:
        yield where, value
    elif isinstance(value, _ARRAYS):
        for index, each in enumerate(value):
            element = _MISSING if isinstance(each, _ARRAYS) else each
            yield from _found(element, path, f"{where}[{index}]")
    else:
        inner = f"{where}.{path[0]}" if where else path[0]
        yield from _found(_field(value, path[0]), path[1:], inner)


def _field(value: object, name: str) -> object:
    if isinstance(value, dict):
        return value.get(name, _MISSING)
    cls: Any = type(value)  # no Hashable for mypy, which the cache needs
    attribute = _attributes(cls).get(name)
    return _MISSING if attribute is None else getattr(value, attribute)


@lru_cache(_KEPT)
def _attributes(cls: Any) -> dict[str, str]:
    """Return the attribute of each field of a message class; a keyword has an underscore more."""
    fields = [name for name, _ in getattr(cls, "_FIELDS", ())]
    return dict(zip(fields, getattr(cls, "__struct_fields__", fields), strict=True))


# Rates


def _counted(
    rules: Rules, name: str, target: str, now: float, counts: Counts
) -> tuple[Decision | None, Counts]:
    """Return the counts with this request, or the refusal if a rate is reached."""
    rates = [each for each in rules.rate if matches(each.target, target)]
    if not rates:
        return None, counts
    new = dict(counts.times)
    for rate in rates:
        key = name, rate.target
        recent = [each for each in new.get(key, ()) if now - each < rate.period]
        if len(recent) >= rate.count:
            return _too_soon(rate, recent, now), counts
        new[key] = (*recent, now)
    return None, Counts(new)


def _too_soon(rate: Rate, recent: list[float], now: float) -> Decision:
    wait = recent[-rate.count] + rate.period - now
    reason = f"{rate.target}: at most {rate.text}; try again in {wait:.1f} s"
    return refused(reason, rate.line, wait)
