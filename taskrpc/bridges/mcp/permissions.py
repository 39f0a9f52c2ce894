"""What an agent may do: all that its user may, or what a policy permits. Pure.

A `Door` has the policy. Without one, the agent has the rights of the user who started the bridge,
as clients of rosbridge have.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from taskrpc.bridges.door.decisions import Outcome
from taskrpc.errors import TaskRpcError
from taskrpc.spi import names

if TYPE_CHECKING:
    from taskrpc.bridges.door import Door

Verb: TypeAlias = Literal["call", "read"]
"""`call` a service or an action, `read` a topic."""


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
        if decision.outcome in (Outcome.ALLOWED, Outcome.DRY_RUN):
            return decision.outcome is Outcome.ALLOWED
        reason = decision.reason
        if decision.outcome is Outcome.NEEDS_APPROVAL:
            reason = f"a person must approve {verb} {target}, and this bridge cannot ask one"
        rule = f" (line {decision.line} of the policy)" if decision.line else ""
        raise Refused(f"{reason}{rule}", line=decision.line, retry_after=decision.retry_after)
