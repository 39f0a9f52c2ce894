"""Quantiles of many values, without one large piece of memory.

A list of so many floats, once freed, would change how glibc hands out memory in this process from
then on, and with it what is measured: see `benchmarks.harness.workloads.phases`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection

_FINENESS = 64
"""Classes for each factor of e, among which the one with the quantile is looked for first."""


def quantile(values: Collection[float], share: float) -> float:
    """The least value that at least this share of the positive values does not exceed."""
    classes = Counter(map(_class_of, values))
    wanted = max(1, math.ceil(share * len(values)))
    for number in sorted(classes):
        if wanted <= classes[number]:
            return sorted(value for value in values if _class_of(value) == number)[wanted - 1]
        wanted -= classes[number]
    raise ValueError("expected values, got none")


def _class_of(value: float) -> int:
    return math.floor(math.log(value) * _FINENESS)
