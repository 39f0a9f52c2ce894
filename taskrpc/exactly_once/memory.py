"""Completions that last as long as the object which keeps them."""

from __future__ import annotations

from collections.abc import Sequence

from taskrpc.request_ids.ids import Client, Completion

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
            new = self._new
            new.append(completion)
            if len(new) >= _MOST_NEW or len(completion.answer) >= _LARGE:
                self._enter()

    def _enter(self) -> None:
        new, self._new = self._new, []
        firsts: dict[Client, int] = {}
        unsettled: list[Completion] = []
        principal, client, first = "", b"", 0
        for completion in reversed(new):
            same = completion.client == client and completion.principal == principal
            if same and completion.sequence < first:  # as most are
                continue
            principal, client = who = completion.principal, completion.client
            first = firsts.get(who, 0)
            if completion.first_incomplete > first:
                first = firsts[who] = completion.first_incomplete
            elif completion.sequence < first:
                continue
            unsettled.append(completion)
        for who, first in firsts.items():
            known = self._by_client.setdefault(who, {})
            for each in known.values():  # an earlier batch may have settled more
                if each.first_incomplete > first:
                    first = firsts[who] = each.first_incomplete  # noqa: PLW2901
            for number in [each for each in known if each < first]:
                del known[number]
        for completion in reversed(unsettled):
            who = completion.principal, completion.client
            if completion.sequence >= firsts[who]:
                self._by_client[who][completion.sequence] = completion
