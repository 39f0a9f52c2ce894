"""How a topic's messages are passed on: how many are kept, and what must not be lost."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

Reliability: TypeAlias = Literal["reliable", "best_effort"]
Durability: TypeAlias = Literal["volatile", "transient_local"]

MAX_DEPTH = 2**31


class QoS(msgspec.Struct, frozen=True):
    """What a publisher offers or a subscription asks for, by ROS 2's names.

    A publisher and a subscription match unless the subscription asks for more: `reliable` of a
    `best_effort` publisher, or `transient_local` of a `volatile` one.

    Raises ValueError for anything else than what the fields say.
    """

    depth: int = 10
    """How many messages are kept for a reader that is behind, and of `transient_local` publishers
    for those who come later; the oldest go first."""
    reliability: Reliability = "reliable"
    durability: Durability = "volatile"
    """`transient_local` publishers give those who come later the last `depth` messages."""

    def __post_init__(self) -> None:
        depth: object = self.depth
        if isinstance(depth, bool) or not isinstance(depth, int) or not 1 <= depth < MAX_DEPTH:
            raise ValueError(f"depth: expected a number from 1 on, got {depth!r}")
        _check("reliability", self.reliability, ("reliable", "best_effort"))
        _check("durability", self.durability, ("volatile", "transient_local"))

    @property
    def is_reliable(self) -> bool:
        """Whether it is more than best effort."""
        return self.reliability == "reliable"

    @property
    def is_latched(self) -> bool:
        """Whether it is about messages from before, too."""
        return self.durability == "transient_local"


def qos_of(qos: QoS | int) -> QoS:
    """A depth alone stands for reliable, volatile messages, as in ROS. Raises ValueError."""
    return qos if isinstance(qos, QoS) else QoS(qos)


def _check(field: str, value: str, expected: tuple[str, ...]) -> None:
    if value not in expected:
        raise ValueError(f"{field}: expected {' or '.join(map(repr, expected))}, got {value!r}")
