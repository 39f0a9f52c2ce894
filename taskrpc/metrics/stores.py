"""What is measured of a store in a file: how many changes wait for the disk together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from taskrpc.metrics.families import Family, Histogram, Kind

_BOUNDS = tuple(float(2**n) for n in range(11))


class CountingStore(Protocol):
    """A store that counts its transactions, as `SqliteStore` and `SqliteCompletions` do."""

    @property
    def transactions(self) -> Mapping[int, int]:
        """How many there were, by how many calls shared one."""


def store_families(store: CountingStore) -> list[Family]:
    """What a store in a file has done: `metrics.add(lambda: store_families(store))`."""
    sizes = Histogram(_BOUNDS)
    for size, times in store.transactions.items():
        sizes.observe(size, times)
    name, what = "taskrpc_store_transaction_changes", "How many changes were stored together."
    return [Family(name, Kind.HISTOGRAM, what, sizes.samples())]
