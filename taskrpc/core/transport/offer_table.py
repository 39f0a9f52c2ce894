"""The services that an endpoint offers, by name and by method id."""

from __future__ import annotations

from taskrpc.core.transport.base import Offer
from taskrpc.errors import NameInUse


class OfferTable:
    """The offers of an endpoint, at most one for each name; a method id is never used twice."""

    def __init__(self) -> None:
        self.by_method: dict[int, Offer] = {}
        self._methods: dict[str, int] = {}
        """The method id of each service."""
        self._last = 0

    def method_of(self, name: str) -> int:
        """The method id of a service, 0 if there is none."""
        return self._methods.get(name, 0)

    def add(self, offer: Offer) -> None:
        """Add an offer. Raises NameInUse if this process already offers its name."""
        if (method := self.method_of(offer.name)) != 0:
            node = self.by_method[method].node
            raise NameInUse(f"{offer.name} is already offered by the node {node} of this process")
        self._last += 1
        self._methods[offer.name] = self._last
        self.by_method[self._last] = offer

    def remove(self, offer: Offer) -> bool:
        """Remove an offer; return whether it was there."""
        method = self.method_of(offer.name)
        if self.by_method.get(method) is not offer:
            return False
        del self._methods[offer.name], self.by_method[method]
        return True
