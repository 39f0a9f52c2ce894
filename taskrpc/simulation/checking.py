"""A scenario as a test of a user's own suite."""

from __future__ import annotations

import os
from pathlib import Path

from taskrpc.simulation.search.search import search
from taskrpc.simulation.search.story import lines_of, story


def check_scenario(
    file: str | os.PathLike[str], *, runs: int = 200, seed: int = 0, jobs: int | None = None
) -> None:
    """Simulate a scenario's file; raises AssertionError with the story if a run fails.

    `def test_warehouse(): check_scenario("warehouse.sim.py")` runs the seeds 0 to 199.

    Args:
        file: the scenario.
        runs: how many runs.
        seed: the first seed.
        jobs: how many processes simulate; by default as many as there are cores.

    Raises TaskRpcError if the scenario cannot be simulated.
    """
    path = Path(file)
    found = search(path, runs=runs, seed=seed, jobs=jobs).failure
    if found is not None:
        repeat = f"Repeat it: taskrpc simulate {path} --seed {found.seed} --runs 1"
        raise AssertionError(f"{story(found, lines_of(found, path.parent))}\n\n{repeat}")
