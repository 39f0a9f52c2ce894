"""Put right what has one right answer: `srvgen fix`.

The answers are the repairs that the parser's own problems carry, so that what is fixed is exactly
what `check` complains about.
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
from .dependencies import Source, closure, problems_of
from .reading import decode, kind_of, meant_path, package_of, parse_definition, read_data

_MANY_PASSES = 100
"""So many strange characters of one line are removed, one a pass."""

_BOM = "\N{ZERO WIDTH NO-BREAK SPACE}"
_UTF16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}

IsMissing = Callable[[str], bool]


@dataclass(frozen=True, slots=True)
class Fix:
    """A file as it is and as it should be."""

    path: Path
    new_path: Path
    before: str
    after: str
    encoding: str
    """What the file is encoded in, for readers; `UTF-8` where that is right already."""

    @property
    def is_needed(self) -> bool:
        """Whether there is anything to change."""
        return (self.path, self.before, "UTF-8") != (self.new_path, self.after, self.encoding)

    def diff(self) -> Iterator[str]:
        """The lines of a unified diff; name and encoding stand in lines of their own above it."""
        if self.path != self.new_path:
            yield from (f"rename from {self.path}", f"rename to {self.new_path}")
        if self.encoding != "UTF-8":
            yield f"encoding of {self.path}: {self.encoding} to UTF-8"
        before, after = self.before.splitlines(), self.after.splitlines()
        names = (str(self.path), str(self.new_path))
        yield from difflib.unified_diff(before, after, *names, lineterm="")

    def check(self, source: Source) -> None:
        """Look for what is still wrong.

        Raises:
            DefinitionError: the text is not valid yet, or what it needs is not.
        """
        package, kind, name = package_of(self.path), kind_of(self.new_path), self.new_path.stem
        path = str(self.new_path)
        definition = parse_definition(self.after, package, kind, name, path=path)
        closure(definition, source, path=self.new_path, text=self.after)

    def write(self) -> None:
        """Write the file in one step, with its permissions, and give it its new name.

        Raises:
            DefinitionError: the file or its folder cannot be written, or the name is taken.
        """
        if self.path != self.new_path and _is_taken(self.new_path, self.path):
            raise DefinitionError(
                f"expected to rename the file to {self.new_path.name}, got a file of that name",
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
    """What is to be done to a file.

    Args:
        path: the file.
        is_missing: whether there is no type of this full name.

    Raises:
        DefinitionError: the file cannot be read, or its encoding or kind cannot be told.
    """
    new_path = meant_path(path) or path
    kind = kind_of(new_path)
    data = read_data(path)
    text, encoding = _decoded(data, str(path))
    after = fixed(text, package_of(path), kind, new_path.stem, is_missing)
    return Fix(path, new_path, text, after, encoding)


def fixed(text: str, package: str, kind: Kind, name: str, is_missing: IsMissing) -> str:
    """The text with everything put right that has one right answer; line ends stay."""
    for _ in range(_MANY_PASSES):
        repairs = _repairs(text, package, kind, name)
        for number, repair in _references(text, package, is_missing):
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
        # Notepad's "Unicode" has a mark; without one, the zeros beside ASCII tell the order.
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


def _references(text: str, package: str, is_missing: IsMissing) -> Iterator[tuple[int, Repair]]:
    """Repairs of types that read well and that nobody has: `Header`, `time`, `String`."""
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
        # The last line may have no end; it is then written as the one before it.
        newline = _end_of(lines[number - 1]) or _end_of(lines[number - 2]) or "\n"
        lines[number - 1] = _repaired(lines[number - 1], wanted, counts[number - 1], newline)
    return "".join(lines)


def _repaired(line: str, repairs: list[Repair], words: Counter[str], newline: str) -> str:
    end = len(line)
    for start, stop, new in sorted(repairs, reverse=True):
        # A name that another line of the section has would only be the next problem.
        is_taken = new.isidentifier() and words[new] > _words(line).count(new)
        if stop > end or (start > 0 and is_taken):
            continue
        words[new] += 1
        line = line[:start] + new.replace("\n", newline) + line[stop:]
        end = start
    return line


def _words_by_section(lines: list[str]) -> list[Counter[str]]:
    """For each line, how often its section has each word."""
    counts: list[Counter[str]] = []
    words: Counter[str] = Counter()
    for line in lines:
        if line.rstrip() == SEPARATOR:
            words = Counter()
        words.update(_words(line))
        counts.append(words)
    return counts


def _words(line: str) -> list[str]:
    """The words of a line but for those of its comment, which are no names."""
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
