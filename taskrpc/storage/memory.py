"""Completions that last as long as the object which keeps them."""

from __future__ import annotations

from collections.abc import Sequence

from taskrpc.wire.once import Client, Completion

_MOST_NEW = 64
_LARGE = 4096
"""Bytes of an answer that is not left among the new ones."""


class KeptCompletions:
    """Completions by client and number."""

    def __init__(self) -> None:
        self._by_client: dict[Client, dict[int, Completion]] = {}
        # Most completions are settled by one that comes soon after. So they gather here first,
        # and what is settled by then is never entered.
        self._new: list[Completion] = []

    def all(self) -> tuple[Completion, ...]:
        """Every completion that is kept."""
        self._enter()
        return tuple(each for known in self._by_client.values() for each in known.values())

    def keep(self, completion: Completion | None, forgotten: Sequence[Client] = ()) -> None:
        """Forget clients, then keep a completion and no older ones that it settles."""
        if forgotten:
            self._enter()
            for client in forgotten:
                self._by_client.pop(client, None)
        if completion is not None:
            self._new.append(completion)
            if len(self._new) >= _MOST_NEW or len(completion.answer) >= _LARGE:
                self._enter()

    def _enter(self) -> None:
        new, self._new = self._new, []
        by_client: dict[Client, list[Completion]] = {}
        for completion in new:
            client = (completion.principal, completion.client)
            by_client.setdefault(client, []).append(completion)
        for client, completions in by_client.items():
            known = self._by_client.setdefault(client, {})
            first = max(each.first_incomplete for each in completions)
            for number in [each for each in known if each < first]:
                del known[number]
            known.update((each.sequence, each) for each in completions if each.sequence >= first)
