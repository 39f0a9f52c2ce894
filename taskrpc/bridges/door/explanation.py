"""Says in plain words what a name may do by a policy. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from taskrpc.bridges.door.policy import (
    VERBS,
    Hours,
    Limit,
    Limits,
    Rate,
    Rule,
    Rules,
    overlaps,
)

_NOT_BELOW = ", except hidden names and the services that every node has"


def explain(name: str, rules: Rules) -> list[str]:
    """Return lines that say what a name may do, and which of its rules have no effect."""
    lines = [f"{name} (line {rules.line})"]
    for rule, how in _permitted(rules):
        below = _NOT_BELOW if rule.target.endswith("/*") else ""
        lines.append(f"  {how.format(rule)}{below}")
        lines += [f"    {each}" for each in _conditions(rules, rule)]
    lines += [f"  may never {rule}" for rule in rules.never]
    lines.append("  may do nothing else" if len(lines) > 1 else "  may do nothing")
    return [*lines, *(f"  note: {each}" for each in _without_effect(name, rules))]


def _permitted(rules: Rules) -> Iterator[tuple[Rule, str]]:
    """Return the rules that permit something, with what they permit; `{}` stands for the rule."""
    stricter = rules.never
    for listed, how in (
        (rules.dry_run, "may try to {}: the door only says what it would do"),
        (rules.ask, ""),
        (rules.may, "may {}"),
    ):
        for rule in listed:
            if not any(each.includes(rule) for each in stricter):
                approval = f"may {{}} after a person has approved it within {rule.timeout:g} s"
                yield rule, how or approval
        stricter = (*stricter, *listed)


def _conditions(rules: Rules, rule: Rule) -> Iterator[str]:
    for limits in rules.limits if rule.verb != "read" else ():
        if overlaps(limits.target, rule.target):
            for limit in limits.limits:
                yield f"{_where(limits.target, rule)}{_limit(limit)}"
    for rate in rules.rate:
        if overlaps(rate.target, rule.target):
            yield f"{_where(rate.target, rule)}at most {rate.text}"
    for hours in rules.when:
        if overlaps(hours.target, rule.target):
            yield f"{_where(hours.target, rule)}only at {hours}"


def _where(target: str, rule: Rule) -> str:
    return "" if target == rule.target else f"{target}: "


def _limit(limit: Limit) -> str:
    parts = [f"{limit.values}"] if limit.values is not None else []
    if limit.length is not None:
        parts.append(f"length {limit.length}")
    return f"{limit.field}: {', '.join(parts)}"


def _without_effect(name: str, rules: Rules) -> Iterator[str]:
    permitted = [rule for rule, _ in _permitted(rules)]
    for rule in (*rules.dry_run, *rules.ask, *rules.may):
        if rule not in permitted and any(each.includes(rule) for each in rules.never):
            yield f"line {rule.line} has no effect: {name} may never {rule}"
    others: tuple[Limits | Rate | Hours, ...] = (*rules.limits, *rules.rate, *rules.when)
    for one in others:
        verbs = ("call", "publish") if isinstance(one, Limits) else VERBS
        if not any(each.verb in verbs and overlaps(each.target, one.target) for each in permitted):
            unused = f"no rule lets {name} {' or '.join(verbs)} {one.target}"
            yield f"line {one.line} has no effect: {unused}"
