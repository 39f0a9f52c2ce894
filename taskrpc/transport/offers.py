"""The services that a process offers: by their names, and by the numbers that connections know."""

from __future__ import annotations

from taskrpc.errors import NameInUse
from taskrpc.transport.base import Offer


class Offers:
    """At most one offer of a name; a number is never given twice."""

    def __init__(self) -> None:
        self.by_method: dict[int, Offer] = {}
        self._methods: dict[str, int] = {}
        self._last = 0

    def method_of(self, name: str) -> int:
        """The number of a service, 0 if there is none."""
        return self._methods.get(name, 0)

    def add(self, offer: Offer) -> None:
        """One more; raises NameInUse where its name is taken."""
        if (method := self.method_of(offer.name)) != 0:
            node = self.by_method[method].node
            raise NameInUse(f"{offer.name} is already offered by the node {node} of this process")
        self._last += 1
        self._methods[offer.name] = self._last
        self.by_method[self._last] = offer

    def remove(self, offer: Offer) -> bool:
        """One less; returns whether it was there."""
        method = self.method_of(offer.name)
        if self.by_method.get(method) is not offer:
            return False
        del self._methods[offer.name], self.by_method[method]
        return True
