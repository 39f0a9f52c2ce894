"""A Markdown page as what a reader may copy from it: fenced blocks, with the notes before them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

_FENCE = re.compile(r"^```(\w*)\s*$")
_FILE = re.compile(r"^`([^`\s]+\.\w+)`(?:\s*[:,].*)?$")
_NOTE = re.compile(r"^<!--\s*(not run|terminal|started|wrong|exits|finished):?\s*(.*?)\s*-->$")
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
_INLINE = re.compile(r"`([^`\n]+)`")


@dataclass(frozen=True)
class Block:
    """A fenced block. `notes` are the HTML comments before it, `file` the name that it has."""

    kind: str
    text: str
    line: int
    file: str = ""
    notes: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Page:
    """One Markdown file."""

    path: Path
    text: str
    blocks: tuple[Block, ...]

    @property
    def prose(self) -> str:
        """The text without its fenced blocks, and with the line numbers as they were."""
        return re.sub(
            r"^```.*?^```$", lambda m: "\n" * m[0].count("\n"), self.text, flags=re.M | re.S
        )

    def links(self) -> list[str]:
        """The targets of all links."""
        return _LINK.findall(self.prose)

    def inline_code(self) -> list[str]:
        """What stands between single backticks."""
        return _INLINE.findall(self.prose)

    def anchors(self) -> set[str]:
        """What a link may name after `#`."""
        titles = re.findall(r"^#+ (.*)$", self.prose, flags=re.M)
        return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}

    def section(self, title: str) -> str:
        """The text below a heading, up to the next one of its level or above."""
        found = re.search(rf"^(#+) {re.escape(title)}$", self.text, flags=re.M)
        assert found, f"{self.path}: expected a section {title!r}"
        rest = self.text[found.end() :]
        return re.split(rf"^#{{1,{len(found[1])}}} ", rest, maxsplit=1, flags=re.M)[0]

    def rows(self, title: str) -> list[list[str]]:
        """The cells of the table in a section, without backticks and without the heading."""
        lines = re.findall(r"^\|(.*)\|$", self.section(title), flags=re.M)[2:]
        return [[cell.strip().strip("`") for cell in line.split("|")] for line in lines]


def read_page(path: Path) -> Page:
    """Read a page. A fence that is never closed is an error."""
    text = path.read_text(encoding="utf-8")
    return Page(path, text, tuple(_blocks(path, text.splitlines())))


def _blocks(path: Path, lines: list[str]) -> Iterator[Block]:
    opened: tuple[int, str] | None = None
    before: list[str] = []
    for number, line in enumerate(lines, 1):
        fence = _FENCE.match(line)
        if opened is None and fence:
            opened = number, fence[1]
        elif opened is None:
            before = [*before, line] if line.strip() else before
            before = before[-4:]
        elif line == "```":
            body = "\n".join(lines[opened[0] : number - 1])
            file, notes = _about(before)
            yield Block(opened[1], body, opened[0], file, notes)
            opened, before = None, []
    assert opened is None, f"{path}:{opened}: a fence is never closed"


def _about(before: list[str]) -> tuple[str, dict[str, str]]:
    """The file name and the notes in the lines directly before a block."""
    file, notes = "", {}
    for line in reversed(before):
        if note := _NOTE.match(line):
            notes[note[1]] = note[2]
        elif named := _FILE.match(line):
            file = named[1]
        else:
            break
    return file, notes
