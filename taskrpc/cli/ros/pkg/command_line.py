"""`taskrpc pkg`: create, list, executables, prefix and xml, as in `ros2 pkg`."""

from __future__ import annotations

import argparse
from pathlib import Path

from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import Commands, Parser, add_command, add_group, print_names


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about packages."""
    commands = add_group(parser)
    _add_create(commands)
    what = "Output a list of package specific executables"
    command = add_command(commands, "executables", what)
    what = "Name of the package (default: all packages of this workspace)"
    command.add_argument("package_name", nargs="?", help=what)
    what = "Show where each executable is defined"
    command.add_argument("--full-path", action="store_true", help=what)
    command.set_defaults(run=_executables)
    command = add_command(commands, "list", "Output a list of available packages")
    command.set_defaults(run=_list)
    _add_named(commands, "prefix", "Output the folder of a package").set_defaults(run=_prefix)
    command = _add_named(commands, "xml", "Output the XML of the package manifest or a tag of it")
    command.add_argument("-t", "--tag", help="Tag whose text to output")
    command.set_defaults(run=_xml)


def _add_create(commands: Commands) -> None:
    command = add_command(commands, "create", "Create a new ROS 2 package")
    command.add_argument("package_name", help="The package name")
    add = command.add_argument
    add(
        "--package-format",
        "--package_format",
        type=int,
        default=3,
        choices=[2, 3],
        help="The package.xml format (default: 3)",
    )
    what = "The description given in the package.xml"
    add("--description", default="", help=what)
    what = "The license attached to this package; ? lists those that ROS 2's tools know"
    add("--license", default="", help=what)
    what = "Directory where to create the package directory (default: the working directory)"
    add("--destination-directory", default=".", help=what)
    kinds = ["ament_cmake", "ament_python"]
    what = "The build type to process the package with (default: ament_cmake)"
    add("--build-type", default="ament_cmake", choices=kinds, help=what)
    add("--dependencies", nargs="+", default=[], help="List of dependencies")
    add("--maintainer-email", help="Email address of the maintainer of this package")
    add("--maintainer-name", help="Name of the maintainer of this package")
    add("--node-name", default="", help="Name of the empty executable")
    add("--library-name", default="", help="Name of the empty library")
    command.set_defaults(run=_create)


def _add_named(commands: Commands, verb: str, purpose: str) -> Parser:
    command = add_command(commands, verb, purpose)
    command.add_argument("package_name", help="The package name")
    return command


def _create(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.pkg import create

    return create.create(options)


def _list(_: argparse.Namespace) -> int:
    return print_names(_names())


def _executables(options: argparse.Namespace) -> int:
    from taskrpc.ros.installed import executables

    here, wanted = _here(), options.package_name
    if wanted and wanted not in here:
        _print_bundled(wanted, options.full_path)
        return Exit.DONE
    for package in [wanted] if wanted else sorted(here):
        folder = here[package]
        for name in sorted(executables(folder)):
            print(folder / name if options.full_path else f"{package} {name}")
    return Exit.DONE


def _print_bundled(package: str, where: bool) -> None:
    """Print the executables that taskrpc itself has for a package, such as turtlesim."""
    from taskrpc.ros.bundled import EXECUTABLES

    if package not in EXECUTABLES:
        raise _unknown(f"Package '{package}' not found", package)
    for name, target in sorted(EXECUTABLES[package].items()):
        print(target if where else f"{package} {name}")


def _prefix(options: argparse.Namespace) -> int:
    print(_folder(options.package_name))
    return Exit.DONE


def _xml(options: argparse.Namespace) -> int:
    from xml.etree import ElementTree

    from taskrpc.errors import TaskRpcError

    path = _folder(options.package_name) / "package.xml"
    if not path.is_file():
        problem = f"{options.package_name} has no package.xml here"
        raise hinted(NotFound("Package not found"), problem)
    text = path.read_text(encoding="utf-8")
    if options.tag is None:
        print(text.rstrip("\n"))
        return Exit.DONE
    try:
        found = [each for each in ElementTree.fromstring(text.encode()) if each.tag == options.tag]
    except (ElementTree.ParseError, ValueError) as error:
        raise TaskRpcError(f"cannot read {path}: {error}") from None
    if not found:
        raise NotFound(f"No elements with tag '{options.tag}' in {path}")
    for element in found:
        print("".join(element.itertext()).strip())
    return Exit.DONE


def _folder(name: str) -> Path:
    from taskrpc.cli.shared import definitions

    if found := _here().get(name) or _bundled().get(name):
        return found
    folders = definitions.search().packages().get(name)
    if not folders:
        raise _unknown("Package not found", name)
    return folders[0]


def _here() -> dict[str, Path]:
    from taskrpc.ros import workspace

    return workspace.packages(Path.cwd())


def _bundled() -> dict[str, Path]:
    """The folders of the ROS packages that taskrpc contains, besides definitions."""
    from taskrpc.ros import bundled

    return bundled.SHARES | bundled.packages()


def _names() -> list[str]:
    """The names of all packages: of the workspace, of definitions, and of taskrpc."""
    from taskrpc.cli.shared import definitions
    from taskrpc.ros.bundled import EXECUTABLES

    packages = definitions.search().packages()
    return sorted({*_here(), *packages, *_bundled(), *EXECUTABLES, "rclpy"})


def _unknown(problem: str, name: str) -> NotFound:
    from srvgen.definitions.names import did_you_mean

    hint = did_you_mean(name, _names())
    return hinted(NotFound(problem), hint)
