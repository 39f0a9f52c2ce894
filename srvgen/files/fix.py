"""Repairs definition files: `srvgen fix`.

The repairs come from the errors of the parser, so `fix` changes only what `check` reports. An error
with more than one possible correction has no repair.
"""

from __future__ import annotations

import codecs
import difflib
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..definitions.field_types import parse_type
from ..definitions.lines import SEPARATOR
from ..definitions.model import Kind
from ..diagnostics.type_hints import missing_type_repair
from ..errors import DefinitionError, InvalidText, Repair
from .dependencies import DefinitionSource, problems_of, with_dependencies
from .reading import decode, kind_of, meant_path, package_of, parse_definition, read_data

_MAX_PASSES = 100
"""Maximum passes over a file; each pass repairs at most one invalid character per line."""

_BOM = "\N{ZERO WIDTH NO-BREAK SPACE}"
_UTF16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}

IsMissing = Callable[[str], bool]


@dataclass(frozen=True, slots=True)
class Fix:
    """The current and the repaired state of a file."""

    path: Path
    new_path: Path
    before: str
    after: str
    encoding: str
    """The name of the current encoding; `UTF-8` if it need not change."""

    @property
    def is_needed(self) -> bool:
        """Whether the file needs a change."""
        return (self.path, self.before, "UTF-8") != (self.new_path, self.after, self.encoding)

    def diff(self) -> Iterator[str]:
        """The lines of a unified diff; changes of name and encoding come first."""
        if self.path != self.new_path:
            yield from (f"rename from {self.path}", f"rename to {self.new_path}")
        if self.encoding != "UTF-8":
            yield f"encoding of {self.path}: {self.encoding} to UTF-8"
        before, after = self.before.splitlines(), self.after.splitlines()
        names = (str(self.path), str(self.new_path))
        yield from difflib.unified_diff(before, after, *names, lineterm="")

    def check(self, source: DefinitionSource) -> None:
        """Check the repaired text.

        Raises:
            DefinitionError: the text or a dependency is still invalid.
        """
        package, kind, name = package_of(self.path), kind_of(self.new_path), self.new_path.stem
        path = str(self.new_path)
        definition = parse_definition(self.after, package, kind, name, path=path)
        with_dependencies(definition, source, path=self.new_path, text=self.after)

    def write(self) -> None:
        """Replace the file atomically, keep its permissions, and rename it if needed.

        Raises:
            DefinitionError: the file or its folder cannot be written, or the name is taken.
        """
        if self.path != self.new_path and _is_taken(self.new_path, self.path):
            raise DefinitionError(
                f"cannot rename the file to {self.new_path.name}: a file of that name exists",
                path=str(self.path),
            )
        try:
            _replace(self.path.resolve(), self.after.encode())
            if self.path != self.new_path:
                self.path.rename(self.new_path)
        except OSError as error:
            raise DefinitionError(
                f"expected a writable file, got: {error.strerror or error}", path=str(self.path)
            ) from None


def fix_file(path: Path, is_missing: IsMissing) -> Fix:
    """The repairs of a file, not yet written.

    Args:
        path: the file.
        is_missing: whether no type of this full name can be found.

    Raises:
        DefinitionError: the file cannot be read, or its encoding or kind is unknown.
    """
    new_path = meant_path(path) or path
    kind = kind_of(new_path)
    data = read_data(path)
    text, encoding = _decoded(data, str(path))
    after = fixed(text, package_of(path), kind, new_path.stem, is_missing)
    return Fix(path, new_path, text, after, encoding)


def fixed(text: str, package: str, kind: Kind, name: str, is_missing: IsMissing) -> str:
    """The text after all repairs; line ends are not changed."""
    for _ in range(_MAX_PASSES):
        repairs = _repairs(text, package, kind, name)
        for number, repair in _missing_type_repairs(text, package, is_missing):
            repairs.setdefault(number, []).append(repair)
        better = _applied(text, repairs)
        if better == text:
            break
        text = better
    return text


def _decoded(data: bytes, path: str) -> tuple[str, str]:
    if data.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)) or not data.strip(b"\0"):
        what = "UTF-32" if data.strip(b"\0") else "zero bytes"
        if data:
            raise DefinitionError(f"expected UTF-8 text, got {what}", path=path)
    for mark, codec in _UTF16.items():
        # Notepad's "Unicode" has a byte order mark; without it, zero bytes show the order.
        zeros = data[1 if codec == "utf-16-le" else 0 : 64 : 2]
        if data.startswith(mark) or (zeros and not any(zeros)):
            with suppress(UnicodeDecodeError):
                return data.decode(codec).removeprefix(_BOM), "UTF-16"
    text = decode(data, path)
    bare = text.removeprefix(_BOM)
    return bare, "UTF-8" if bare == text else "UTF-8 with BOM"


def _repairs(text: str, package: str, kind: Kind, name: str) -> dict[int, list[Repair]]:
    found: dict[int, list[Repair]] = {}
    try:
        parse_definition(text, package, kind, name)
    except DefinitionError as error:
        for problem in problems_of(error):
            if problem.repair:
                found.setdefault(problem.line, []).append(problem.repair)
    return found


def _missing_type_repairs(
    text: str, package: str, is_missing: IsMissing
) -> Iterator[tuple[int, Repair]]:
    """Repairs of well-formed types that do not exist: `Header`, `time`, `String`."""
    for number, line in enumerate(text.splitlines(), 1):
        code = line.partition("#")[0].replace("\t", " ")
        written, _, rest = code.partition(" ")
        base = written.partition("[")[0]
        meant = missing_type_repair(base)
        if not meant or not rest.strip() or "=" in rest:
            continue
        with suppress(InvalidText):
            type_ = parse_type(written, package)
            if type_.package is None or is_missing(type_.full_name):
                yield number, Repair(0, len(base), meant)


def _applied(text: str, repairs: dict[int, list[Repair]]) -> str:
    lines = text.splitlines(keepends=True)
    counts = _words_by_section(lines)
    for number, wanted in repairs.items():
        # A last line without a line end gets the one of the line before it.
        newline = _end_of(lines[number - 1]) or _end_of(lines[number - 2]) or "\n"
        lines[number - 1] = _repaired(lines[number - 1], wanted, counts[number - 1], newline)
    return "".join(lines)


def _repaired(line: str, repairs: list[Repair], words: Counter[str], newline: str) -> str:
    end = len(line)
    for start, stop, new in sorted(repairs, reverse=True):
        # A repaired name must not collide with another name of the section.
        is_taken = new.isidentifier() and words[new] > _words(line).count(new)
        if stop > end or (start > 0 and is_taken):
            continue
        words[new] += 1
        line = line[:start] + new.replace("\n", newline) + line[stop:]
        end = start
    return line


def _words_by_section(lines: list[str]) -> list[Counter[str]]:
    """For each line, the number of times each word occurs in its section."""
    counts: list[Counter[str]] = []
    words: Counter[str] = Counter()
    for line in lines:
        if line.rstrip() == SEPARATOR:
            words = Counter()
        words.update(_words(line))
        counts.append(words)
    return counts


def _words(line: str) -> list[str]:
    """The words of a line without its comment."""
    return re.findall(r"\w+", line.partition("#")[0])


def _end_of(line: str) -> str:
    return line[len(line.rstrip("\r\n")) :]


def _is_taken(new: Path, old: Path) -> bool:
    return new.exists() and not new.samefile(old)  # one file where X.SRV and X.srv are the same


def _replace(path: Path, data: bytes) -> None:
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        shutil.copymode(path, temporary)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
