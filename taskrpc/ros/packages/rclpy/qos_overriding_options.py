"""Parameters with which a user sets the QoS of a program's topics at its start."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeAlias

from ._impl.graph.qos_policies import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPolicyEnum,
    QoSPolicyKind,
    ReliabilityPolicy,
)
from ._impl.parameters.callbacks import SetParametersResult
from ._impl.parameters.declarations import ParameterDescriptor
from .duration import Duration
from .exceptions import ParameterAlreadyDeclaredException
from .publisher import Publisher
from .qos import QoSProfile
from .subscription import Subscription

if TYPE_CHECKING:
    from ._impl.node_interface import NodeInterface

QosCallbackResult = SetParametersResult
"""The type that a validating callback returns."""
QosCallbackType: TypeAlias = Callable[[QoSProfile], Any]

_WORDS: dict[QoSPolicyKind, type[QoSPolicyEnum]] = {
    QoSPolicyKind.HISTORY: HistoryPolicy,
    QoSPolicyKind.RELIABILITY: ReliabilityPolicy,
    QoSPolicyKind.DURABILITY: DurabilityPolicy,
    QoSPolicyKind.LIVELINESS: LivelinessPolicy,
}


class InvalidQosOverridesError(Exception):
    """The program's callback rejected a profile."""


class QoSOverridingOptions:
    """The policies that parameters can set, such as `qos_overrides./chatter.publisher.depth`.

    Args:
        policy_kinds: the policies.
        callback: checks the resulting profile; returns a `QosCallbackResult`.
        entity_id: a part of the parameter names, if a node has several publishers on a topic.
    """

    def __init__(
        self,
        policy_kinds: Iterable[QoSPolicyKind],
        *,
        callback: QosCallbackType | None = None,
        entity_id: str | None = None,
    ) -> None:
        self._policy_kinds = tuple(policy_kinds)
        self._callback = callback
        self._entity_id = entity_id

    @property
    def policy_kinds(self) -> Iterable[QoSPolicyKind]:
        """The policies that parameters can set."""
        return self._policy_kinds

    @property
    def callback(self) -> QosCallbackType | None:
        """Checks the resulting profile."""
        return self._callback

    @property
    def entity_id(self) -> str | None:
        """Distinguishes several publishers of a node on one topic."""
        return self._entity_id

    @classmethod
    def with_default_policies(
        cls, *, callback: QosCallbackType | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Options for history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def _declare_qos_parameters(
    entity_type: type[Any],
    node: NodeInterface,
    topic_name: str,
    qos: QoSProfile,
    options: QoSOverridingOptions,
) -> None:
    """Declare the parameters of a publisher or subscription, and set its policies to their values.

    Raises InvalidQosOverridesError if the callback of the options rejects the profile.
    """
    if not issubclass(entity_type, (Publisher, Subscription)):
        raise TypeError("Argument `entity_type` should be a subclass of Publisher or Subscription")
    publishes = issubclass(entity_type, Publisher)
    kind = "publisher" if publishes else "subscription"
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    about = f"for {kind} `{topic_name}` with id `{options.entity_id}`"
    for policy in options.policy_kinds:
        if policy == QoSPolicyKind.LIFESPAN and not publishes:
            continue
        word = policy.name.lower()
        name = f"qos_overrides.{topic_name}.{kind}{suffix}.{word}"
        descriptor = ParameterDescriptor(description=f"{word} {about}", read_only=True)
        try:
            default = _get_qos_policy_parameter(qos, policy)
            parameter = node.declare_parameter(name, default, descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        _override_qos_policy_with_param(qos, policy, parameter.value)
    if options.callback is not None and not (result := options.callback(qos)).successful:
        raise InvalidQosOverridesError(
            f"Provided QoS overrides {about}, are not valid: {result.reason}"
        )


def _get_qos_policy_parameter(qos: QoSProfile, policy: QoSPolicyKind) -> str | int | bool:
    """The value of a policy for a parameter: a short name, a number, or nanoseconds."""
    value: Any = getattr(qos, policy.name.lower())
    if isinstance(value, QoSPolicyEnum):
        if value.short_key == "unknown":
            raise ValueError("User provided QoS profile is invalid")
        return value.short_key
    found: int | bool = value.nanoseconds if isinstance(value, Duration) else value
    return found


def _override_qos_policy_with_param(qos: QoSProfile, policy: QoSPolicyKind, value: Any) -> None:
    name = policy.name.lower()
    if policy in _WORDS:
        words = _WORDS[policy]
        if value not in words.short_keys():
            raise RuntimeError(f"Unexpected QoS override for policy `{name}`: `{value}`")
        value = words.get_from_short_key(value)
    elif isinstance(getattr(qos, name), Duration):
        value = Duration(nanoseconds=value)
    setattr(qos, name, value)
