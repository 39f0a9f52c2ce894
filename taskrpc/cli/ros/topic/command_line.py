"""`taskrpc topic`: list, type, find, info, echo, pub, hz, bw, delay, as in `ros2 topic`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module

from taskrpc.cli.shared.parsing import (
    Commands,
    Parser,
    add_command,
    add_group,
    add_lengths,
    number,
    whole,
)

_GRAPH = "taskrpc.cli.ros.topic.topic_graph"
_ECHO = "taskrpc.cli.ros.topic.echo"
_MEASURES = "taskrpc.cli.ros.topic.measures"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about topics."""
    what = "Consider hidden topics as well"
    parser.add_argument("--include-hidden-topics", action="store_true", help=what)
    commands = add_group(parser)
    _add_bw(commands)
    _add_delay(commands)
    _add_echo(commands)
    _add_find(commands)
    _add_hz(commands)
    _add_info(commands)
    _add_list(commands)
    _add_pub(commands)
    _add(commands, "type", "Print a topic's type", _GRAPH, "print_type")


def _add(
    commands: Commands, name: str, purpose: str, home: str, action: str, *, topic: str = "Name"
) -> Parser:
    """Add a command; the module `home` of its action is imported when the command runs."""
    from taskrpc.cli.shared.remote import add_connect, add_discovery

    parser = add_command(commands, name, purpose)
    if topic:
        parser.add_argument("topic_name", help=f"{topic} of the topic (e.g. '/chatter')")
    add_connect(parser)
    what = "Measure by the time that a simulation publishes on /clock"
    add_discovery(parser, what if home == _MEASURES else "")
    parser.set_defaults(run=lambda options: int(getattr(import_module(home), action)(options)))
    return parser


def _add_list(commands: Commands) -> None:
    what = "Output a list of available topics"
    parser = _add(commands, "list", what, _GRAPH, "print_list", topic="")
    what = "Additionally show the topic type"
    parser.add_argument("-t", "--show-types", action="store_true", help=what)
    _add_listing(parser, "-a", "--all")
    what = "List full details about each topic"
    parser.add_argument("-v", "--verbose", action="store_true", help=what)


def _add_find(commands: Commands) -> None:
    what = "Output a list of available topics of a given type"
    parser = _add(commands, "find", what, _GRAPH, "print_found", topic="")
    what = "Name of the topic type to filter for (e.g. 'std_msgs/msg/String')"
    parser.add_argument("topic_type", help=what)
    _add_listing(parser)


def _add_listing(parser: Parser, *names: str) -> None:
    what = "Only display the number of topics discovered"
    parser.add_argument("-c", "--count-topics", "--count", action="store_true", help=what)
    # No default here: it would overwrite the option of the same name before the subcommand.
    parser.add_argument(
        *("--include-hidden-topics", *names),
        action="store_true",
        default=argparse.SUPPRESS,
        help="Consider hidden topics as well",
    )
    parser.add_argument("--json", action="store_true", help="Print JSON")


def _add_info(commands: Commands) -> None:
    parser = _add(commands, "info", "Print information about a topic", _GRAPH, "print_info")
    what = "Print each publisher and subscription: node, type, QoS, process"
    parser.add_argument("-v", "--verbose", action="store_true", help=what)
    parser.add_argument("--json", action="store_true", help="Print JSON")


def _add_echo(commands: Commands) -> None:
    from taskrpc.cli.ros.topic.qos_options import add_qos

    parser = _add(commands, "echo", "Output messages from a topic", _ECHO, "echo")
    what = "Type of the message (e.g. 'std_msgs/msg/String')"
    parser.add_argument("message_type", nargs="?", default="", help=what)
    what = "Output all values separated by commas (e.g. for plotting)"
    parser.add_argument("--csv", action="store_true", help=what)
    what = "Output one field only (e.g. 'pose.position')"
    parser.add_argument("--field", metavar="FIELD", help=what)
    add_lengths(parser, flow_style="Output each message in one line")
    parser.add_argument("--raw", action="store_true", help="Output the bytes that ROS would send")
    what = "Output messages for which a Python expression is true; m is the message"
    parser.add_argument("--filter", metavar="EXPR", help=what)
    what = "Output the time of arrival and the number of each message"
    parser.add_argument("-i", "--include-message-info", action="store_true", help=what)
    parser.add_argument("--once", action="store_true", help="Output one message and exit")
    what = "Exit after this many seconds; with --once and no message, with exit code 1"
    parser.add_argument(
        "--timeout", metavar="S", type=number("above 0", lambda n: n > 0), help=what
    )
    what = "Do not report lost messages"
    parser.add_argument("--no-lost-messages", action="store_true", help=what)
    add_qos(parser)


def _add_pub(commands: Commands) -> None:
    from taskrpc.cli.ros.topic.qos_options import add_qos

    parser = _add(
        commands, "pub", "Publish messages on a topic", "taskrpc.cli.ros.topic.pub", "run"
    )
    what = "Type of the message (e.g. 'std_msgs/msg/String')"
    parser.add_argument("message_type", help=what)
    what = "The message as YAML (\"{data: 'hello'}\") or as FIELD=VALUE (default: no fields set)"
    parser.add_argument("values", nargs="*", metavar="values", help=what)
    parser.mixed = True
    what = "Read the message from standard input"
    parser.add_argument("--stdin", action="store_true", help=what)
    what = "Publish the messages of a file, one YAML document for each message"
    parser.add_argument("--yaml-file", metavar="FILE", help=what)
    positive = number("above 0", lambda n: n > 0)
    what = "Messages per second (default: 1)"
    parser.add_argument("-r", "--rate", metavar="N", type=positive, default=1.0, help=what)
    what = "Print only every N-th message; 0 prints none (default: 1)"
    parser.add_argument("-p", "--print", metavar="N", type=whole(0), default=1, help=what)
    group = parser.add_mutually_exclusive_group()
    group.add_argument("-1", "--once", action="store_true", help="Publish one message and exit")
    what = "Publish this many messages and exit; 0: no limit (default: 0)"
    group.add_argument("-t", "--times", metavar="N", type=whole(0), default=0, help=what)
    what = "Wait for this many subscriptions first (default: 1 with --once and --times, else 0)"
    parser.add_argument(
        "-w", "--wait-matching-subscriptions", metavar="N", type=whole(0), help=what
    )
    what = "The most seconds to wait for subscriptions"
    parser.add_argument("--max-wait-time-secs", metavar="S", type=positive, help=what)
    what = "Seconds to stay after the last message (default: 0.1)"
    at_least = number("from 0 on", lambda n: n >= 0)
    parser.add_argument("--keep-alive", metavar="S", type=at_least, default=0.1, help=what)
    parser.add_argument("-n", "--node-name", metavar="NAME", help="Name of the publishing node")
    add_qos(parser)


def _add_hz(commands: Commands) -> None:
    what = "Print the average receiving rate"
    parser = _add(commands, "hz", what, _MEASURES, "hz", topic="")
    _add_topics(parser)
    _add_window(parser, 10_000)
    what = "Measure messages for which a Python expression is true; m is the message"
    parser.add_argument("--filter", metavar="EXPR", help=what)
    what = "Measure by wall time, also with --use-sim-time"
    parser.add_argument("--wall-time", action="store_true", help=what)


def _add_bw(commands: Commands) -> None:
    what = "Display the bandwidth that a topic uses"
    parser = _add(commands, "bw", what, _MEASURES, "bw", topic="")
    _add_topics(parser)
    _add_window(parser, 100)


def _add_delay(commands: Commands) -> None:
    what = "Display the delay of a topic's messages by the time stamps in their headers"
    _add_window(_add(commands, "delay", what, _MEASURES, "delay"), 10_000)


def _add_topics(parser: Parser) -> None:
    what = "Name of the topic (e.g. '/chatter'); several are compared in a table"
    parser.add_argument("topic_names", metavar="topic_name", nargs="*", help=what)
    what = "Measure all topics that exist now"
    parser.add_argument("-a", "--all", dest="all_topics", action="store_true", help=what)


def _add_window(parser: Parser, messages: int) -> None:
    from taskrpc.cli.ros.topic.qos_options import add_qos

    what = f"How many recent messages to measure (default: {messages})"
    names: Sequence[str] = ("-w", "--window")
    parser.add_argument(*names, metavar="N", type=whole(1), default=messages, help=what)
    add_qos(parser)
