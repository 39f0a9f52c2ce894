"""`taskrpc ros`: makes `import rclpy` work in plain `python`, an editor, pytest and notebooks."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import add_command, add_group


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc ros` its commands."""
    commands = add_group(parser)
    purpose = "Let programs of this Python environment import rclpy"
    add_command(commands, "enable", purpose).set_defaults(run=_enable)
    purpose = "Undo taskrpc ros enable"
    add_command(commands, "disable", purpose).set_defaults(run=_disable)
    purpose = "Say whether programs of this Python environment can import rclpy"
    add_command(commands, "status", purpose).set_defaults(run=_status)


def _enable(_: Namespace) -> int:
    import sys

    from taskrpc.ros import environment

    folder = environment.enable()
    print(f"programs of {sys.prefix} can import rclpy and interface packages from now on")
    for name in environment.FILES:
        print(f"  wrote {folder / name}")
    print("run them with python FILE.py; taskrpc ros disable undoes this")
    return Exit.DONE


def _disable(_: Namespace) -> int:
    import sys

    from taskrpc.ros import environment

    removed = environment.disable()
    for path in removed:
        print(f"removed {path}")
    if not removed:
        print(f"nothing to remove: programs of {sys.prefix} cannot import rclpy through taskrpc")
    return Exit.DONE


def _status(_: Namespace) -> int:
    import sys

    from taskrpc.ros import environment
    from taskrpc.ros.hook import real_rclpy

    if real := real_rclpy():
        print(f"programs of {sys.prefix} import ROS 2's own rclpy: {real}")
    elif environment.is_enabled() and not environment.is_of_this_version():
        print("enabled by another version of taskrpc: run taskrpc ros enable again")
    elif environment.is_enabled():
        print(f"enabled: programs of {sys.prefix} can import rclpy")
    else:
        print(f"not enabled: programs of {sys.prefix} cannot import rclpy; taskrpc run starts them")
    return Exit.DONE
