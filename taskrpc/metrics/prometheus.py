"""Prometheus' text format 0.0.4: families in, text out."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from taskrpc.metrics.families import Family, shown

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_NAME = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
_LABEL = re.compile(r"(?!__)[a-zA-Z_][a-zA-Z0-9_]*")
_IN_HELP = str.maketrans({"\\": r"\\", "\n": r"\n"})
_IN_LABEL = str.maketrans({"\\": r"\\", "\n": r"\n", '"': r"\""})


def render(families: Iterable[Family]) -> str:
    """The text that Prometheus reads; families without samples are left out.

    Raises ValueError for a name that Prometheus would refuse, or one that comes twice.
    """
    lines: list[str] = []
    seen: set[str] = set()
    for family in families:
        if family.name in seen:
            raise ValueError(f"the family {family.name} comes twice")
        seen.add(family.name)
        if family.samples:
            lines.extend(_lines(family))
    return "".join(f"{line}\n" for line in lines)


def _lines(family: Family) -> Iterator[str]:
    name = _checked(family.name, _NAME)
    yield f"# HELP {name} {family.help.translate(_IN_HELP)}"
    yield f"# TYPE {name} {family.kind.value}"
    for sample in family.samples:
        yield f"{name}{sample.suffix}{_labels(sample.labels)} {shown(sample.value)}"


def _labels(labels: Mapping[str, str] | None) -> str:
    if not labels:
        return ""
    inside = (
        f'{_checked(label, _LABEL)}="{value.translate(_IN_LABEL)}"'
        for label, value in labels.items()
    )
    return "{" + ",".join(inside) + "}"


def _checked(name: str, allowed: re.Pattern[str]) -> str:
    if not allowed.fullmatch(name):
        raise ValueError(f"expected a name that matches {allowed.pattern}, got {name!r}")
    return name
