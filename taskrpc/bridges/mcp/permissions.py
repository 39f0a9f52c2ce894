"""What an agent may do: all that its user may, or what a policy permits. Pure.

`Door` is what the bridge needs of a policy. Without one, the agent has the rights of the user who
started the bridge, as clients of rosbridge have.
"""

from __future__ import annotations

from enum import Enum
from typing import Literal, Protocol, TypeAlias

from taskrpc.errors import TaskRpcError
from taskrpc.spi import names

Verb: TypeAlias = Literal["call", "read"]
"""`call` a service or an action, `read` a topic."""

_ALLOWED, _DRY_RUN, _NEEDS_APPROVAL = "allowed", "dry run", "needs approval"


class Decision(Protocol):
    """What a policy says about one request."""

    @property
    def outcome(self) -> Enum:
        """Its value is `allowed`, `refused`, `needs approval` or `dry run`."""

    @property
    def line(self) -> int:
        """The line of the rule in the policy; 0 if there is none."""

    @property
    def reason(self) -> str:
        """Why the request is refused: what was expected and what came."""

    @property
    def retry_after(self) -> float:
        """Seconds after which a request that came too soon may be repeated."""


class Door(Protocol):
    """A policy that decides about each request."""

    def decide(self, name: str, verb: str, target: str, message: object = None) -> Decision:
        """Decide whether `name` may do this now; a permission counts for its rate."""

    def permits(self, name: str, verb: str, target: str) -> bool:
        """Return whether `name` may do this with some message; nothing counts for a rate."""


class Refused(TaskRpcError):
    """A policy refused a request; it did not run.

    Attributes:
        line: the line of the rule in the policy; 0 if there is none.
        retry_after: the seconds after which the request may be repeated; 0.0 if that does not help.
    """

    not_executed = True

    def __init__(self, message: str, *, line: int = 0, retry_after: float = 0.0) -> None:
        self.line = line
        self.retry_after = retry_after
        super().__init__(message)


class Permissions:
    """What one agent may do; `name` is its name in the policy."""

    def __init__(self, door: Door | None = None, name: str = "") -> None:
        self._door = door
        self.name = name

    def shows(self, verb: Verb, target: str) -> bool:
        """Return whether the agent sees a service, an action or a topic.

        Without a policy, it does not see the services that every node of ROS has: there are nine of
        them for each node, and a model gets lost in long lists.
        """
        if self._door is None:
            return not names.is_of_every_node(target)
        return self._door.permits(self.name, verb, target)

    def check(self, verb: Verb, target: str, message: object = None) -> bool:
        """Return whether to carry out a request; False means to say only what it would do.

        Raises Refused.
        """
        if self._door is None:
            return True
        decision = self._door.decide(self.name, verb, target, message)
        outcome = decision.outcome.value
        if outcome in (_ALLOWED, _DRY_RUN):
            return bool(outcome == _ALLOWED)
        reason = decision.reason
        if outcome == _NEEDS_APPROVAL:
            reason = f"a person must approve {verb} {target}, and this bridge cannot ask one"
        rule = f" (line {decision.line} of the policy)" if decision.line else ""
        raise Refused(f"{reason}{rule}", line=decision.line, retry_after=decision.retry_after)
