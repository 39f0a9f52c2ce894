"""Completions that last as long as the object which keeps them."""

from __future__ import annotations

from collections.abc import Sequence

from taskrpc.wire.once import Client, Completion


class KeptCompletions:
    """Completions by client and number."""

    def __init__(self) -> None:
        self._by_client: dict[Client, dict[int, Completion]] = {}

    def all(self) -> tuple[Completion, ...]:
        """Every completion that is kept."""
        return tuple(each for known in self._by_client.values() for each in known.values())

    def keep(self, completion: Completion | None, forgotten: Sequence[Client] = ()) -> None:
        """Forget clients, then keep a completion and no older ones that it settles."""
        for client in forgotten:
            self._by_client.pop(client, None)
        if completion is not None:
            client = (completion.principal, completion.client)
            first = completion.first_incomplete
            known = self._by_client.setdefault(client, {})
            for number in [each for each in known if each < first]:
                del known[number]
            known[completion.sequence] = completion
