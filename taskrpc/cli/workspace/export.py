"""`taskrpc export`: makes a workspace for a real robot from programs and definitions."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import add_command, add_group

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from taskrpc.ros.colcon.export import Exported


def configure(parser: argparse.ArgumentParser) -> None:
    """Give the parser of `taskrpc export` its commands."""
    commands = add_group(parser)
    purpose = "Make a workspace that colcon builds with a real ROS 2"
    colcon = add_command(commands, "colcon", purpose)
    colcon.add_argument("out", metavar="OUT", help="Folder to make the workspace in")
    what = "Folder with the programs and definitions (default: the working directory)"
    colcon.add_argument("--from", metavar="FOLDER", dest="source", default=".", help=what)
    what = "Name of the package of the programs (default: the name of their folder)"
    colcon.add_argument("--package-name", metavar="NAME", default="", help=what)
    colcon.set_defaults(run=_colcon)


def _colcon(options: argparse.Namespace) -> int:
    from taskrpc.ros.colcon.export import export

    done = export(Path(options.source), Path(options.out), options.package_name)
    for name, folder in done.folders.items():
        print(f"made {name}: {folder}")
    for note in done.notes:
        print(f"note: {note}")
    print("on a computer with ROS 2:")
    for line in _commands(options.out, _last(done)):
        print(f"  {line}")
    return Exit.DONE


def _last(done: Exported) -> str:
    """Return a command that succeeds after the workspace is built."""
    from taskrpc.ros.installed import executables

    for package, folder in done.folders.items():
        if found := executables(folder):
            return f"ros2 run {package} {min(found)}"
    return f"ros2 pkg xml {next(iter(done.folders))}"


def _commands(out: str, last: str) -> list[str]:
    return [
        f"cd {shlex.quote(out)}",
        "source /opt/ros/$ROS_DISTRO/setup.bash",
        "colcon build",
        "source install/setup.bash",
        last,
    ]
