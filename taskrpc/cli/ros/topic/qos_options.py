"""The QoS options of ros2; without them, a subscription matches the current publishers."""

from __future__ import annotations

from collections.abc import Sequence

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    import argparse
    from typing import TypeAlias

    from taskrpc.qos import Durability, QoS, Reliability
    from taskrpc.spi import TopicEndpoint

Profile: TypeAlias = "tuple[int, Reliability, Durability]"
_PROFILES: dict[str, Profile] = {
    "default": (10, "reliable", "volatile"),
    "system_default": (10, "reliable", "volatile"),
    "services_default": (10, "reliable", "volatile"),
    "sensor_data": (5, "best_effort", "volatile"),
    "parameters": (1000, "reliable", "volatile"),
    "parameter_events": (1000, "reliable", "volatile"),
    "action_status_default": (1, "reliable", "transient_local"),
}
_KEEP_ALL = 2**31 - 1
_DEFAULT = "system_default"
_OPEN = (_DEFAULT, "best_available")
"""The values with which the profile or the current publishers determine a policy."""


def add_qos(parser: argparse.ArgumentParser) -> None:
    """Give a command the options `--qos-…`."""
    from taskrpc.cli.shared.parsing import add_ignored, whole

    what = "A preset QoS profile"
    parser.add_argument("--qos-profile", choices=sorted(_PROFILES), help=what)
    what = "How many messages to keep"
    parser.add_argument("--qos-depth", metavar="N", type=whole(1, _KEEP_ALL), help=what)
    what = "Whether to keep all messages or only the last ones"
    _add_policy(parser, "history", what, "keep_last", "keep_all")
    what = "Whether lost messages are sent again"
    _add_policy(parser, "reliability", what, "best_effort", "reliable", "best_available")
    what = "Whether a subscription that starts later gets the last messages"
    _add_policy(parser, "durability", what, "transient_local", "volatile", "best_available")
    # Discovery notices the end of a program without liveliness leases.
    kinds = [_DEFAULT, "automatic", "manual_by_topic"]
    add_ignored(parser, "--qos-liveliness", choices=kinds)
    add_ignored(parser, "--qos-liveliness-lease-duration-seconds", metavar="S", type=float)


def _add_policy(parser: argparse.ArgumentParser, policy: str, what: str, *choices: str) -> None:
    known = [_DEFAULT, *choices]
    parser.add_argument(
        f"--qos-{policy}", choices=known, default=_DEFAULT, help=f"{what} (default: {_DEFAULT})"
    )


def qos_to_publish(options: argparse.Namespace) -> QoS:
    """Return ros2's default for publishing, changed by the options."""
    return _over(options, _PROFILES["default"])


def qos_to_subscribe(options: argparse.Namespace, publishers: Sequence[TopicEndpoint]) -> QoS:
    """Return the QoS that matches all publishers, changed by the options."""
    from taskrpc.qos import qos_for_all

    qos = qos_for_all(publishers, 100)
    return _over(options, (qos.depth, qos.reliability, qos.durability))


def _over(options: argparse.Namespace, default: Profile) -> QoS:
    from taskrpc.qos import QoS

    depth, reliability, durability = _PROFILES.get(options.qos_profile or "", default)
    if options.qos_history == "keep_all":
        depth = _KEEP_ALL
    return QoS(
        options.qos_depth or depth,
        reliability if options.qos_reliability in _OPEN else options.qos_reliability,
        durability if options.qos_durability in _OPEN else options.qos_durability,
    )
