"""`package.xml` in formats 2 and 3: what a package is called, who keeps it and what it needs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal
from xml.sax.saxutils import escape, quoteattr

from srvgen.definitions.names import LOWER_RULE, is_package_name
from taskrpc.errors import TaskRpcError

_LINTERS = {
    "ament_cmake": ("ament_lint_auto", "ament_lint_common"),
    "ament_python": ("ament_copyright", "ament_flake8", "ament_pep257", "python3-pytest"),
}


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What a package says of itself."""

    name: str
    build_type: Literal["ament_cmake", "ament_python"]
    maintainer: str
    email: str
    description: str = "TODO: Package description"
    license: str = "TODO: License declaration"
    version: str = "0.0.0"
    format: int = 3
    depends: tuple[str, ...] = ()
    exec_depends: tuple[str, ...] = ()
    buildtool: str = "ament_cmake"
    """What an ament_cmake package is built with."""
    has_interfaces: bool = False
    """Whether messages, services and actions are generated from it."""
    is_linted: bool = True
    """Whether its tests look at how it is written, as those of `pkg create` do."""


def checked_name(name: str) -> str:
    """The name of a package; raises TaskRpcError where ROS 2 refuses it."""
    if is_package_name(name):
        return name
    raise TaskRpcError(f"expected {LOWER_RULE} as the name of a package, got {name!r}")


def package_xml(package: Manifest) -> str:
    """The text of its `package.xml`."""
    schema = f"http://download.ros.org/schema/package_format{package.format}.xsd"
    parts = [_facts(package), *_needs(package), _export(package)]
    body = "\n\n".join("\n".join(f"  {line}" for line in part) for part in parts if part)
    return (
        '<?xml version="1.0"?>\n'
        f'<?xml-model href="{schema}" schematypens="http://www.w3.org/2001/XMLSchema"?>\n'
        f'<package format="{package.format}">\n{body}\n</package>\n'
    )


def _facts(package: Manifest) -> list[str]:
    email = quoteattr(package.email)
    return [
        _tag("name", package.name),
        _tag("version", package.version),
        _tag("description", package.description),
        f"<maintainer email={email}>{escape(package.maintainer)}</maintainer>",
        _tag("license", package.license),
    ]


def _needs(package: Manifest) -> Iterator[list[str]]:
    if package.build_type == "ament_cmake":
        yield [_tag("buildtool_depend", package.buildtool)]
    yield [_tag("depend", name) for name in package.depends]
    if package.has_interfaces:
        yield [
            _tag("buildtool_depend", "rosidl_default_generators"),
            _tag("exec_depend", "rosidl_default_runtime"),
        ]
    yield [_tag("exec_depend", name) for name in package.exec_depends]
    if package.is_linted:
        yield [_tag("test_depend", name) for name in _LINTERS[package.build_type]]
    if package.has_interfaces:
        yield [_tag("member_of_group", "rosidl_interface_packages")]


def _export(package: Manifest) -> list[str]:
    return ["<export>", f"  {_tag('build_type', package.build_type)}", "</export>"]


def _tag(name: str, text: str) -> str:
    return f"<{name}>{escape(text)}</{name}>"
