"""`taskrpc daemon`: ros2's commands for its daemon; taskrpc needs no daemon."""

from __future__ import annotations

import argparse

from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import add_command, add_group

_NOT_RUNNING = "The daemon is not running"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about the daemon."""
    commands = add_group(parser)
    for name, purpose, text in (
        ("start", "Do nothing: programs find each other without a daemon", "No daemon is needed"),
        ("status", "Say that no daemon is running", _NOT_RUNNING),
        ("stop", "Do nothing: no daemon is running", _NOT_RUNNING),
    ):
        command = add_command(commands, name, purpose)
        command.set_defaults(run=_say, text=text)


def _say(options: argparse.Namespace) -> Exit:
    print(f"{options.text}: programs find each other without one here")
    return Exit.DONE
