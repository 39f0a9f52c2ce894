"""Whether the published figures are of the present code: a digest of what a call runs through.

A comment, a docstring or another layout of the lines leaves the digest as it is, and every Python
computes the same one. It needs no git: the test of the table also runs in a source distribution.
"""

from __future__ import annotations

import hashlib
import io
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MEASURED = ("taskrpc/core/wire", "taskrpc/core/transport")
"""The folders whose changes make the figures old."""

_LAYOUT = {tokenize.ENCODING, tokenize.COMMENT, tokenize.NL, tokenize.ENDMARKER}
_ENDS = {tokenize.NEWLINE: "NEWLINE", tokenize.INDENT: "INDENT", tokenize.DEDENT: "DEDENT"}
_FSTRING_START = getattr(tokenize, "FSTRING_START", -1)
_FSTRING_END = getattr(tokenize, "FSTRING_END", -1)


def sources_digest(root: Path = ROOT) -> str:
    """The digest of the measured code."""
    found = hashlib.sha256()
    for folder in MEASURED:
        for path in sorted((root / folder).rglob("*.py")):
            found.update(f"{path.relative_to(root).as_posix()}\n".encode())
            found.update(digest_of(path.read_text(encoding="utf-8")).encode())
    return found.hexdigest()[:16]


def digest_of(source: str) -> str:
    """The digest of one module's code."""
    statements = [line for line in _statements(source) if not _is_docstring(line)]
    return hashlib.sha256(repr(statements).encode()).hexdigest()


def _statements(source: str) -> Iterator[list[str]]:
    """The tokens of each logical line; an indent or a dedent is a line of its own."""
    line: list[str] = []
    for kind, text in _tokens(source):
        if kind not in _ENDS:
            line.append(text)
            continue
        if line:
            yield line
            line = []
        if kind != tokenize.NEWLINE:
            yield [_ENDS[kind]]
    if line:
        yield line


def _tokens(source: str) -> Iterator[tuple[int, str]]:
    """Tokens without layout. An f-string is one token, as it is before Python 3.12."""
    lines = io.StringIO(source).readlines()
    depth, begin = 0, (0, 0)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == _FSTRING_START:
            begin = begin if depth else token.start
            depth += 1
        elif token.type == _FSTRING_END:
            depth -= 1
            if not depth:
                yield tokenize.STRING, _between(lines, begin, token.end)
        elif not depth and token.type not in _LAYOUT:
            yield token.type, token.string


def _between(lines: list[str], begin: tuple[int, int], end: tuple[int, int]) -> str:
    """The source from one place to another, each a line number and a column."""
    if begin[0] == end[0]:
        return lines[begin[0] - 1][begin[1] : end[1]]
    first, last = lines[begin[0] - 1][begin[1] :], lines[end[0] - 1][: end[1]]
    return "".join([first, *lines[begin[0] : end[0] - 1], last])


def _is_docstring(line: list[str]) -> bool:
    """Whether a logical line is only a string: the docstring of a module, a class, a field…"""
    return all(text[-1] in "\"'" for text in line)
