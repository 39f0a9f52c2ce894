"""The numbers of one process's requests to exactly-once services, by their stores."""

from __future__ import annotations

import os

from taskrpc.request_ids.ids import Numbers


class Counting:
    """A client id and a count for each store; a new one where the old cannot go on."""

    def __init__(self) -> None:
        self._numbers: dict[bytes, Numbers] = {}

    def numbers(self, store_id: bytes) -> Numbers:
        """What counts the next request to a store."""
        known = self._numbers.get(store_id)
        # One request that waits long must not keep the store from forgetting all later ones.
        if known is None or known.is_over:
            known = self._numbers[store_id] = Numbers(os.urandom(16), store_id)
        return known
