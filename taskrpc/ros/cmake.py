"""What a CMake package installs of Python, read from its `CMakeLists.txt` without running CMake.

Programs are what `ros2 run` starts; modules are what other packages import. Conditions and loops
are not evaluated: each command counts as if it stood by itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

Command: TypeAlias = tuple[str, list[str]]
"""A command's name in lower case, and its arguments with all variables replaced."""

_COMMENT = re.compile(r"#\[(=*)\[.*?\]\1\]|#[^\n]*", re.DOTALL)
_COMMAND = re.compile(r"\b([A-Za-z_]\w*)\s*\(((?:\"(?:\\.|[^\"\\])*\"|[^()\"])*)\)")
_ARGUMENT = re.compile(r"\"((?:\\.|[^\"\\])*)\"|([^\s;\"]+)")
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_KINDS = ("PROGRAMS", "FILES", "DIRECTORY")
_END_OF_ITEMS = {
    *("DESTINATION", "TYPE", "PERMISSIONS", "FILE_PERMISSIONS", "DIRECTORY_PERMISSIONS"),
    *("USE_SOURCE_PERMISSIONS", "CONFIGURATIONS", "COMPONENT", "RENAME", "OPTIONAL"),
    *("EXCLUDE_FROM_ALL", "FILES_MATCHING", "PATTERN", "REGEX", "MESSAGE_NEVER"),
}
_SITE = "site-packages"
"""What stands for the folder of installed Python modules."""

_SITE_VARIABLES = ("PYTHON_INSTALL_DIR", "PYTHON3_INSTALL_DIR", "Python3_SITELIB", "Python_SITELIB")
_IN_SITE = re.compile(rf"(?:.*/)?(?:{_SITE}|dist-packages)(?:/(?P<inner>.*?))?/?")


def programs(package: Path) -> dict[str, Path]:
    """The Python programs that a package installs: their names, and the file of each."""
    found: dict[str, Path] = {}
    for kind, items, destination, rename in _installations(package):
        if _IN_SITE.fullmatch(destination):
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
    """The Python modules that a package installs: names to import, with their files or folders.

    `a.b` is a module in a package `a` that other commands, or nothing else, make.
    """
    found: dict[str, Path] = {}
    for command, arguments in _commands(package):
        if command == "ament_python_install_package" and arguments:
            name = arguments[0]
            found.setdefault(name, package / (_after("PACKAGE_DIR", arguments) or name))
        elif command == "ament_python_install_module" and arguments:
            file = package / arguments[0]
            inner = _after("DESTINATION_SUFFIX", arguments)
            found.setdefault(_dotted(inner, file.stem), file)
    for kind, items, destination, rename in _installations(package):
        place = _IN_SITE.fullmatch(destination)
        if place is None:
            continue
        inner = place["inner"] or ""
        for item in items:
            for name, path in _installed(package, kind, item, rename):
                found.setdefault(_dotted(inner, name), path)
    return {name: path for name, path in found.items() if name and path.exists()}


def is_python(path: Path) -> bool:
    """Whether a file is a Python program, by its ending or its first line."""
    if path.suffix == ".py":
        return True
    with path.open("rb") as file:
        first = file.readline()
    return first.startswith(b"#!") and b"python" in first


def _installed(package: Path, kind: str, item: str, rename: str) -> Iterator[tuple[str, Path]]:
    """The modules that one item of a command `install` becomes, below its destination."""
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
        # The content of the folder goes to the destination itself.
        yield from ((each.stem, each) for each in sorted(path.glob("*.py")))
        yield from ((each.parent.name, each.parent) for each in sorted(path.glob("*/__init__.py")))


def _dotted(folder: str, name: str) -> str:
    return ".".join(part for part in (*folder.split("/"), name) if part)


def _files(path: Path) -> list[Path]:
    return sorted(path.rglob("*")) if path.is_dir() else [path]


def _installations(package: Path) -> Iterator[tuple[str, list[str], str, str]]:
    """The commands `install`: the kind, the items, their destination and the new name."""
    for command, arguments in _commands(package):
        if command != "install" or not arguments or arguments[0] not in _KINDS:
            continue
        end = next(
            (index for index, word in enumerate(arguments) if word in _END_OF_ITEMS), len(arguments)
        )
        items = arguments[1:end]
        rename = _after("RENAME", arguments)
        yield arguments[0], items, _after("DESTINATION", arguments), rename


def _after(keyword: str, arguments: Sequence[str]) -> str:
    """The value of a keyword, "" where it has none."""
    if keyword not in arguments[:-1]:
        return ""
    return arguments[arguments.index(keyword) + 1]


def _commands(package: Path) -> Iterator[Command]:
    """The commands of a package's `CMakeLists.txt`, in order."""
    try:
        text = (package / "CMakeLists.txt").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    here = dict.fromkeys(("CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR"), str(package))
    here.update(dict.fromkeys(("CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR"), str(package)))
    known = {**here, **dict.fromkeys(_SITE_VARIABLES, _SITE), "PROJECT_NAME": package.name}
    for found in _COMMAND.finditer(_COMMENT.sub("", text)):
        name, arguments = found[1].lower(), _arguments(found[2], known)
        if name == "project" and arguments:
            known["PROJECT_NAME"] = known["CMAKE_PROJECT_NAME"] = arguments[0]
        elif name == "set" and arguments:
            known[arguments[0]] = ";".join(arguments[1:])
        yield name, arguments


def _arguments(text: str, known: dict[str, str]) -> list[str]:
    """The arguments of a command. A variable that holds a list becomes several."""
    found: list[str] = []
    for quoted, plain in _ARGUMENT.findall(text):
        value = _VARIABLE.sub(lambda name: known.get(name[1], name[0]), quoted or plain)
        found += [part for part in value.split(";") if part]
    return found
