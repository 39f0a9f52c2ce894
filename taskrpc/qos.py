"""Quality of service of topics: how many messages are kept, and which may be lost."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, Protocol, TypeAlias

import msgspec

Reliability: TypeAlias = Literal["reliable", "best_effort"]
Durability: TypeAlias = Literal["volatile", "transient_local"]

MAX_DEPTH = 2**31


class Timing(msgspec.Struct, array_like=True, frozen=True):
    """How often a publisher sends messages and is declared alive, in nanoseconds; 0: no limit.

    As an offer or as a request. Only rclpy's publishers and subscriptions watch these times.
    """

    deadline: int = 0
    """The longest time between two messages."""
    lease: int = 0
    """The longest time between two declarations that the publisher is alive."""
    is_manual: bool = False
    """Whether the program declares this, by messages and by `assert_liveliness`."""

    def refusal_of(self, requested: Timing) -> Literal["LIVELINESS", "DEADLINE"] | None:
        """Return the policy that is weaker than requested; None if there is none."""
        if (requested.is_manual and not self.is_manual) or _exceeds(self.lease, requested.lease):
            return "LIVELINESS"
        return "DEADLINE" if _exceeds(self.deadline, requested.deadline) else None


class QoS(msgspec.Struct, frozen=True):
    """The quality that a publisher offers or a subscription requests, with ROS 2's names.

    A publisher and a subscription match unless the subscription requests more than the publisher
    offers: `reliable` from `best_effort`, `transient_local` from `volatile`, or a shorter time.

    Raises ValueError for an invalid field.
    """

    depth: int = 10
    """How many messages are kept for a subscription that has fallen behind, and by a
    `transient_local` publisher for later subscriptions; the oldest are dropped first."""
    reliability: Reliability = "reliable"
    """`best_effort` messages may be lost on the way."""
    durability: Durability = "volatile"
    """A `transient_local` publisher sends the last `depth` messages to later subscriptions."""
    timing: Timing | None = None
    """The deadline and the liveliness; None means no limits."""

    def __post_init__(self) -> None:
        depth: object = self.depth
        if isinstance(depth, bool) or not isinstance(depth, int) or not 1 <= depth < MAX_DEPTH:
            raise ValueError(f"depth: expected a number from 1 on, got {depth!r}")
        _check("reliability", self.reliability, ("reliable", "best_effort"))
        _check("durability", self.durability, ("volatile", "transient_local"))

    @property
    def is_reliable(self) -> bool:
        """Whether messages must not be lost on the way."""
        return self.reliability == "reliable"

    @property
    def is_latched(self) -> bool:
        """Whether later subscriptions get earlier messages too."""
        return self.durability == "transient_local"


def qos_of(qos: QoS | int) -> QoS:
    """Return the QoS; a number means reliable, volatile messages with this depth, as in ROS.

    Raises ValueError.
    """
    return qos if isinstance(qos, QoS) else QoS(qos)


class Offer(Protocol):
    """What a publisher offers."""

    @property
    def reliable(self) -> bool:
        """Whether its reliability is `reliable`."""

    @property
    def latched(self) -> bool:
        """Whether its durability is `transient_local`."""


def qos_for_all(publishers: Collection[Offer], depth: int) -> QoS:
    """Return the QoS of a subscription that matches all publishers, as ROS's tools choose it."""
    reliable = all(each.reliable for each in publishers)
    latched = bool(publishers) and all(each.latched for each in publishers)
    return QoS(
        depth,
        "reliable" if reliable else "best_effort",
        "transient_local" if latched else "volatile",
    )


def _exceeds(offered: int, requested: int) -> bool:
    return bool(requested) and not 0 < offered <= requested


def _check(field: str, value: str, expected: tuple[str, ...]) -> None:
    if value not in expected:
        raise ValueError(f"{field}: expected {' or '.join(map(repr, expected))}, got {value!r}")
