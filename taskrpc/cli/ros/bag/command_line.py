"""`taskrpc bag`: record, info, play, as in `ros2 bag`; and sequence, a diagram of the calls."""

from __future__ import annotations

import argparse
from importlib import import_module

from taskrpc.cli.shared.parsing import (
    Commands,
    Parser,
    add_command,
    add_group,
    add_ignored,
    number,
    whole,
)
from taskrpc.cli.shared.remote import add_connect, add_discovery

_FILE = "The recording: a .mcap or .db3 file, or the folder of a bag of rosbag2"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about recordings."""
    commands = add_group(parser)
    _add_info(commands)
    _add_play(commands)
    _add_record(commands)
    _add_sequence(commands)


def _add(commands: Commands, name: str, purpose: str, home: str) -> Parser:
    """Add a command; its module, with a function of its name, is imported when it runs."""
    parser = add_command(commands, name, purpose)
    module = f"taskrpc.cli.ros.bag.{home}"
    parser.set_defaults(run=lambda options: int(getattr(import_module(module), name)(options)))
    return parser


def _add_record(commands: Commands) -> None:
    parser = _add(commands, "record", "Record topics and the calls of services", "record")
    add = parser.add_argument
    add("topic_names", metavar="topic", nargs="*", help="Topics to record (e.g. '/chatter')")
    what = "The file to write (default: rosbag2_DATE-TIME.mcap)"
    add("-o", "--output", metavar="FILE", help=what)
    add("-a", "--all", action="store_true", help="Record all topics and all services")
    add("--all-topics", action="store_true", help="Record all topics")
    add("--all-services", action="store_true", help="Record the calls of all services")
    add("--topics", metavar="TOPIC", nargs="+", default=[], help="Topics to record")
    what = "Services whose calls to record; their servers must publish introspection events"
    add("--services", metavar="SERVICE", nargs="+", default=[], help=what)
    what = "Also record the topics whose names contain this regular expression"
    add("-e", "--regex", metavar="REGEX", default="", help=what)
    what = "Never record topics and services whose names contain this regular expression"
    add("--exclude-regex", metavar="REGEX", default="", help=what)
    what = "With --all and --all-topics, record hidden topics as well"
    add("--include-hidden-topics", action="store_true", help=what)
    what = "Record only topics that exist now"
    add("--no-discovery", action="store_true", help=what)
    add_ignored(parser, "-s", "--storage", choices=["mcap"])
    add_connect(parser)
    add_ignored(parser, "--use-sim-time", action="store_true")


def _add_info(commands: Commands) -> None:
    parser = _add(commands, "info", "Print the contents of a recording", "info")
    parser.add_argument("file", metavar="FILE", help=_FILE)
    what = "Print only the names of the topics"
    parser.add_argument("-t", "--topic-name", action="store_true", help=what)
    parser.add_argument("--json", action="store_true", help="Print JSON")


def _add_play(commands: Commands) -> None:
    parser = _add(commands, "play", "Publish the messages of a recording again", "play")
    add = parser.add_argument
    add("file", metavar="FILE", help=_FILE)
    positive = number("above 0", lambda n: n > 0)
    at_least = number("from 0 on", lambda n: n >= 0)
    what = "Recorded seconds to play in one second (default: 1)"
    add("-r", "--rate", metavar="RATE", type=positive, default=1.0, help=what)
    what = "Seconds to skip at the beginning of the recording (default: 0)"
    add("--start-offset", metavar="S", type=at_least, default=0.0, help=what)
    what = "Seconds of the recording to play (default: to its end)"
    add("--playback-duration", metavar="S", type=at_least, help=what)
    what = "Seconds to wait for subscriptions before the first message (default: 0.5)"
    add("-d", "--delay", metavar="S", type=at_least, default=0.5, help=what)
    add("-l", "--loop", action="store_true", help="Play again and again, until Ctrl-C")
    add("--topics", metavar="TOPIC", nargs="+", default=[], help="Topics to play (default: all)")
    what = "Services whose calls to play (default: all)"
    add("--services", metavar="SERVICE", nargs="+", default=[], help=what)
    what = "Topics to leave out"
    add("--exclude-topics", metavar="TOPIC", nargs="+", default=[], help=what)
    what = "Services whose calls to leave out"
    add("--exclude-services", metavar="SERVICE", nargs="+", default=[], help=what)
    what = "Call the services again, instead of publishing the events of their calls"
    add("--publish-service-requests", action="store_true", help=what)
    add_connect(parser)
    add_discovery(parser)


def _add_sequence(commands: Commands) -> None:
    what = "Print a Mermaid sequence diagram of the recorded calls"
    parser = _add(commands, "sequence", what, "info")
    parser.add_argument("file", metavar="FILE", help=_FILE)
    what = "Draw at most this many calls (default: 100)"
    parser.add_argument("--limit", metavar="N", type=whole(1), default=100, help=what)
    what = "Draw the calls of these services only"
    parser.add_argument("--services", metavar="SERVICE", nargs="+", default=[], help=what)
