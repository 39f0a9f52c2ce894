"""Reads from `CMakeLists.txt` which Python programs and modules a package installs.

`ros2 run` starts the programs; other packages import the modules. CMake itself does not run.
Conditions are not evaluated: the commands of all branches count.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypeAlias

Command: TypeAlias = tuple[str, list[str]]
"""A command's name in lower case, and its arguments after all variables are replaced."""

_COMMENT = re.compile(r"#\[(=*)\[.*?\]\1\]|#[^\n]*", re.DOTALL)
_COMMAND = re.compile(r"\b([A-Za-z_]\w*)\s*\(((?:\"(?:\\.|[^\"\\])*\"|[^()\"])*)\)")
_ARGUMENT = re.compile(r"\"((?:\\.|[^\"\\])*)\"|([^\s;\"]+)")
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_MOST = 10_000
"""Most commands that are read: nested loops may produce any number."""

_HERE_VARIABLES = (
    *("CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR"),
    *("CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR"),
)
_KINDS = ("PROGRAMS", "FILES", "DIRECTORY")
_END_OF_ITEMS = {
    *("DESTINATION", "TYPE", "PERMISSIONS", "FILE_PERMISSIONS", "DIRECTORY_PERMISSIONS"),
    *("USE_SOURCE_PERMISSIONS", "CONFIGURATIONS", "COMPONENT", "RENAME", "OPTIONAL"),
    *("EXCLUDE_FROM_ALL", "FILES_MATCHING", "PATTERN", "REGEX", "MESSAGE_NEVER"),
}
_SITE = "site-packages"
"""Stands for the folder of installed Python modules."""

_SITE_VARIABLES = ("PYTHON_INSTALL_DIR", "PYTHON3_INSTALL_DIR", "Python3_SITELIB", "Python_SITELIB")
_IN_SITE_FOLDER = re.compile(rf"(?:.*/)?(?:{_SITE}|dist-packages)(?:/(?P<inner>.*?))?/?")


class Installation(NamedTuple):
    """A command `install`."""

    kind: str
    """`PROGRAMS`, `FILES` or `DIRECTORY`."""
    items: list[str]
    """Paths from the package's folder, or absolute ones."""
    destination: str
    rename: str
    """The new name of the one item, "" if it keeps its name."""


def programs(package: Path) -> dict[str, Path]:
    """The Python programs that a package installs, by name, each with its file."""
    found: dict[str, Path] = {}
    for kind, items, destination, rename in installations(package):
        if _IN_SITE_FOLDER.fullmatch(destination):
            continue
        if kind == "PROGRAMS":
            files = [package / item for item in items]
        elif re.match(r"(lib|libexec|bin)(/|$)", destination):
            files = [path for item in items for path in _files(package / item)]
        else:
            continue
        for path in files:
            if path.is_file() and is_python(path):
                found.setdefault(rename or path.name, path)
    return found


def modules(package: Path) -> dict[str, Path]:
    """The Python modules that a package installs, by import name, each with its file or folder.

    `a.b` is a module in a package `a`, which may have no other files.
    """
    found: dict[str, Path] = {}
    for command, arguments in commands(package):
        if command == "ament_python_install_package" and arguments:
            name = arguments[0]
            found.setdefault(name, package / (_after("PACKAGE_DIR", arguments) or name))
        elif command == "ament_python_install_module" and arguments:
            file = package / arguments[0]
            inner = _after("DESTINATION_SUFFIX", arguments)
            found.setdefault(_dotted(inner, file.stem), file)
    for kind, items, destination, rename in installations(package):
        match = _IN_SITE_FOLDER.fullmatch(destination)
        if match is None:
            continue
        inner = match["inner"] or ""
        for item in items:
            for name, path in _installed(package, kind, item, rename):
                found.setdefault(_dotted(inner, name), path)
    return {name: path for name, path in found.items() if name and path.exists()}


def installations(package: Path) -> Iterator[Installation]:
    """The commands `install` of a package for programs, files and folders."""
    for command, arguments in commands(package):
        if command != "install" or not arguments or arguments[0] not in _KINDS:
            continue
        end = next(
            (index for index, word in enumerate(arguments) if word in _END_OF_ITEMS), len(arguments)
        )
        destination, rename = _after("DESTINATION", arguments), _after("RENAME", arguments)
        yield Installation(arguments[0], arguments[1:end], destination, rename)


def commands(package: Path) -> Iterator[Command]:
    """The commands of a package's `CMakeLists.txt` in order; a loop's once for each value."""
    try:
        text = (package / "CMakeLists.txt").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return iter(())
    written = [(found[1].lower(), found[2]) for found in _COMMAND.finditer(_COMMENT.sub("", text))]
    known = {**dict.fromkeys(_SITE_VARIABLES, _SITE), "PROJECT_NAME": package.name}
    known.update(dict.fromkeys(_HERE_VARIABLES, str(package)))
    return islice(_evaluated(written, known, package), _MOST)


def is_python(path: Path) -> bool:
    """Whether a file is a Python program, judged by its suffix or its first line."""
    if path.suffix == ".py":
        return True
    with path.open("rb") as file:
        first = file.readline()
    return first.startswith(b"#!") and b"python" in first


def _installed(package: Path, kind: str, item: str, rename: str) -> Iterator[tuple[str, Path]]:
    """The modules that one item of an installation becomes, named from its destination."""
    path = package / item
    if kind != "DIRECTORY":
        name = rename or path.name
        if name.endswith(".py"):
            yield name.removesuffix(".py").removesuffix("__init__"), path
    elif not item.endswith("/"):
        yield rename or path.name, path
    elif (path / "__init__.py").is_file():
        yield "", path
    else:
        # With a slash at the end, the folder's content is installed, not the folder.
        yield from ((each.stem, each) for each in sorted(path.glob("*.py")))
        yield from ((each.parent.name, each.parent) for each in sorted(path.glob("*/__init__.py")))


def _dotted(folder: str, name: str) -> str:
    return ".".join(part for part in (*folder.split("/"), name) if part)


def _files(path: Path) -> list[Path]:
    return sorted(path.rglob("*")) if path.is_dir() else [path]


def _after(keyword: str, arguments: Sequence[str]) -> str:
    """The value behind a keyword, or "" if there is none."""
    if keyword not in arguments[:-1]:
        return ""
    return arguments[arguments.index(keyword) + 1]


def _evaluated(
    written: Sequence[tuple[str, str]], known: dict[str, str], package: Path
) -> Iterator[Command]:
    """Commands with their variables replaced; `known` receives the variables that they set."""
    index = 0
    while index < len(written):
        name, text = written[index]
        arguments = _arguments(text, known)
        index += 1
        if name == "foreach" and arguments:
            inner = written[index : _end_of_loop(written, index)]
            index += len(inner)
            for value in _values_of_loop(arguments, known):
                known[arguments[0]] = value
                yield name, arguments  # empty loops count towards the limit too
                yield from _evaluated(inner, known, package)
            continue
        if name == "project" and arguments:
            known["PROJECT_NAME"] = known["CMAKE_PROJECT_NAME"] = arguments[0]
        elif name == "set" and arguments:
            known[arguments[0]] = ";".join(arguments[1:])
        elif name == "file" and len(arguments) > 1 and arguments[0].startswith("GLOB"):
            known[arguments[1]] = ";".join(_matches(arguments, package))
        yield name, arguments


def _end_of_loop(written: Sequence[tuple[str, str]], start: int) -> int:
    depth = 1
    for index in range(start, len(written)):
        depth += {"foreach": 1, "endforeach": -1}.get(written[index][0], 0)
        if not depth:
            return index
    return len(written)


def _values_of_loop(arguments: Sequence[str], known: Mapping[str, str]) -> list[str]:
    """The values of `foreach(NAME [IN ITEMS|LISTS] …)`."""
    values = [each for each in arguments[1:] if each not in ("IN", "ITEMS", "LISTS")]
    if "LISTS" in arguments:
        return [part for name in values for part in known.get(name, "").split(";") if part]
    return values


def _matches(arguments: Sequence[str], package: Path) -> Iterator[str]:
    """The paths that `file(GLOB NAME …)` finds; absolute ones without RELATIVE."""
    is_relative = "RELATIVE" in arguments
    is_deep = arguments[0] == "GLOB_RECURSE"
    options = {"RELATIVE", "CONFIGURE_DEPENDS", "FOLLOW_SYMLINKS", _after("RELATIVE", arguments)}
    for pattern in arguments[2:]:
        if pattern in options:
            continue
        inner = pattern.removeprefix(f"{package}/")
        if Path(inner).anchor or ".." in Path(inner).parts:  # `/*` is not absolute on Windows
            continue
        try:
            found = sorted(package.rglob(inner) if is_deep else package.glob(inner))
        except ValueError:  # a pattern that only CMake understands
            continue
        for path in found:
            yield path.relative_to(package).as_posix() if is_relative else str(path)


def _arguments(text: str, known: dict[str, str]) -> list[str]:
    """The arguments of a command. A variable that holds a list becomes several arguments."""
    found: list[str] = []
    for quoted, plain in _ARGUMENT.findall(text):
        value = _VARIABLE.sub(lambda name: known.get(name[1], name[0]), quoted or plain)
        found += [part for part in value.split(";") if part]
    return found
