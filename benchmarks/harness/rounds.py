"""The rounds: everybody's turn in changing order, and the baseline's again and again between."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

from benchmarks.contenders import BASELINE
from benchmarks.harness.processes import ChildFailed, Pair, all_cores
from benchmarks.harness.results import Results
from benchmarks.harness.workloads import IN_FLIGHT, Workload

TURNS = 4
"""Turns for which one measurement of the baseline counts: a machine's speed drifts."""

Say = Callable[[str], None]


class Field:
    """The contenders that are still in the race."""

    def __init__(self, pairs: Sequence[Pair], results: Results) -> None:
        self.pairs = list(pairs)
        self._results = results

    @property
    def baseline(self) -> Pair:
        """The baseline's processes."""
        return next(pair for pair in self.pairs if pair.contender is BASELINE)

    def others(self, seed: int) -> list[Pair]:
        """All but the baseline, in an order of the round's own."""
        pairs = [pair for pair in self.pairs if pair.contender is not BASELINE]
        random.Random(seed).shuffle(pairs)
        return pairs

    def drop(self, pair: Pair, why: ChildFailed) -> None:
        """Go on without a contender whose process failed; the baseline's failure ends the run."""
        if pair.contender is BASELINE:
            raise why
        pair.close()
        self.pairs.remove(pair)
        self._results.left_out[pair.contender.name] = str(why)


def run_round(
    number: int, field: Field, workload: Workload, *, seconds: float, results: Results
) -> None:
    """Measure one workload once for everybody."""
    cores = all_cores()
    if workload.pinned:
        cores = {max(cores)}
    baseline = {}
    for turn, pair in enumerate(field.others(number)):
        if turn % TURNS == 0:
            baseline = _measured(field.baseline, workload, cores, seconds)
            if turn == 0:
                results.add(workload, BASELINE.name, baseline, baseline)
        if workload.suits(pair.contender):
            try:
                sample = _measured(pair, workload, cores, seconds)
            except ChildFailed as error:
                field.drop(pair, error)
            else:
                results.add(workload, pair.contender.name, sample, baseline)


def _measured(pair: Pair, workload: Workload, cores: set[int], seconds: float) -> dict[str, float]:
    pair.pin(cores)
    return pair.measure(payload=workload.payload, in_flight=workload.in_flight, seconds=seconds)


def _renew(field: Field) -> None:
    for pair in list(field.pairs):
        try:
            pair.renew()
        except ChildFailed as error:
            field.drop(pair, error)


def _settle(field: Field, seconds: float) -> None:
    """Load everybody once for nothing: a fresh heap is not yet what it stays."""
    for pair in list(field.pairs):
        try:
            in_flight = min(IN_FLIGHT[-1], pair.contender.most_in_flight)
            pair.measure(payload=0, in_flight=in_flight, seconds=seconds)
        except ChildFailed as error:
            field.drop(pair, error)


def run_rounds(
    field: Field,
    phases: Sequence[Sequence[Workload]],
    *,
    rounds: int,
    seconds: float,
    results: Results,
    say: Say,
) -> None:
    """Measure everything, phase by phase; small calls with new processes in each round."""
    _settle(field, seconds)
    for workloads in phases:
        for number in range(rounds):
            say(f"{workloads[0].what}: round {number + 1} of {rounds}")
            if number and not workloads[0].payload:
                _renew(field)
                _settle(field, seconds)
            for workload in workloads:
                run_round(number, field, workload, seconds=seconds, results=results)
