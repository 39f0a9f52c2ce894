"""Warnings: valid values that are probably mistakes, and dependencies missing in package.xml."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Collection, Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from ..definitions.literals import CURLY
from ..definitions.model import Constant, Definition, Field, sections
from ..errors import DefinitionWarning
from .reading import kind_folder, read_text

_STRINGS = ("string", "wstring")
_FLOAT32_MAX = 3.4028234663852886e38
_STRANGE = CURLY + "\N{NO-BREAK SPACE}\N{ZERO WIDTH SPACE}"


def file_warnings(definition: Definition, path: Path) -> Iterator[DefinitionWarning]:
    """All warnings about a definition in a file and about the package.xml of its package."""
    text = read_text(path)
    yield from value_warnings(definition, text, path)
    folder = kind_folder(path)
    if folder is not None:
        try:
            declared = declared_dependencies(folder.parent)
        except DefinitionWarning as warning:
            yield warning
        else:
            if declared is not None:
                yield from undeclared_dependencies(definition, text, path, declared)


def value_warnings(definition: Definition, text: str, path: Path) -> Iterator[DefinitionWarning]:
    """Warnings about constants and defaults whose value is probably not what the author meant."""
    lines = text.removeprefix("\ufeff").splitlines()
    for section in sections(definition):
        elements: tuple[Field | Constant, ...] = (*section.fields, *section.constants)
        for one in elements:
            line = lines[one.line - 1]
            for offset, message, hint in _value_problems(one, line):
                yield _warning(message, path, line, (one.line, offset + 1), hint)


def undeclared_dependencies(
    definition: Definition, text: str, path: Path, declared: Collection[str]
) -> Iterator[DefinitionWarning]:
    """Warnings about fields of packages that package.xml does not declare as dependencies."""
    lines = text.removeprefix("\ufeff").splitlines()
    reported = {definition.package, *declared}
    for section in sections(definition):
        for field in section.fields:
            package = field.type.package
            if package and package not in reported:
                reported.add(package)
                yield _warning(
                    f"expected package.xml to declare {package}, which this field needs",
                    path,
                    lines[field.line - 1],
                    (field.line, 1),
                    f"add <depend>{package}</depend>",
                )


def declared_dependencies(folder: Path) -> frozenset[str] | None:
    """The dependencies in a package's `package.xml` and its own name; None without the file.

    Raises:
        DefinitionWarning: the file cannot be read.
    """
    path = folder / "package.xml"
    if not path.is_file():
        return None
    from xml.etree import ElementTree  # slow to import, and many packages have no package.xml

    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise DefinitionWarning(
            f"expected a package manifest in XML, got: {error}", path=str(path), line=1, column=1
        ) from None
    return frozenset(
        (one.text or "").strip() for one in root if one.tag == "name" or one.tag.endswith("depend")
    )


def package_cycle(definitions: Iterable[Definition]) -> list[str]:
    """Packages that depend on each other in a circle; the first is repeated at the end; or none.

    The types need not form a circle: ROS 2 builds whole packages one after the other.
    """
    needs: dict[str, set[str]] = {}
    for definition in definitions:
        for section in sections(definition):
            for field in section.fields:
                if field.type.package and field.type.package != definition.package:
                    needs.setdefault(definition.package, set()).add(field.type.package)
    try:
        TopologicalSorter({one: sorted(needs[one]) for one in sorted(needs)}).prepare()
    except CycleError as error:
        ring: list[str] = error.args[1]
        return ring[::-1]  # graphlib lists a dependency before its dependent
    return []


def _value_problems(one: Field | Constant, line: str) -> Iterator[tuple[int, str, str]]:
    """The offset, message and hint of each warning about one field or constant."""
    base = one.type if isinstance(one, Constant) else one.type.base
    if base == "float32":
        yield from _overflows(one)
    if base not in _STRINGS:
        return
    code, mark, comment = line.partition("#")
    start = one.column - 1 + len(one.name)
    value = code[start:].lstrip(" \t=").rstrip()
    quote = value[:1]
    if mark and quote in ("'", '"') and value.count(quote) % 2 and quote in comment:
        yield (
            len(code),
            f"expected the text to end before '#', got {value!r} as the whole text: "
            "'#' begins a comment, even inside quotes",
            "write \\x23 for a # in a text",
        )
    for char in _STRANGE:
        at = code.find(char, start)
        if at >= 0:
            name = unicodedata.name(char).lower()
            yield at, f"expected plain text, got a {name} in the value", ""
    at = code.find("//", start)
    if at > 0 and code[at - 1].isspace() and not value.startswith(("'", '"', "[")):
        yield at, "expected a comment to begin with '#', got '//' in the value", ""


def _overflows(one: Field | Constant) -> Iterator[tuple[int, str, str]]:
    """ROS accepts such a value in a definition, but no message with it can be sent."""
    value = one.value if isinstance(one, Constant) else one.default
    for number in value if isinstance(value, (list, tuple)) else (value,):
        if isinstance(number, float) and _FLOAT32_MAX < abs(number) < math.inf:
            problem = f"expected a float32 up to {_FLOAT32_MAX:.7g}, got {number:g}"
            yield one.column - 1, problem, "use float64"


def _warning(
    message: str, path: Path, line: str, position: tuple[int, int], hint: str
) -> DefinitionWarning:
    return DefinitionWarning(
        message, path=str(path), line=position[0], column=position[1], source_line=line, hint=hint
    )
