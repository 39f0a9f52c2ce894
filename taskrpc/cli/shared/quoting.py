"""Hints for requests that a shell has changed.

bash and PowerShell remove quotes. cmd keeps single quotes and splits at the spaces inside them.
PowerShell 5.1 drops double quotes inside single quotes. bash turns `{a:1,b:2}` into two words.
Git Bash turns an argument that begins with a slash into a Windows path.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from taskrpc.cli.shared.command import hinted
from taskrpc.errors import InvalidName, InvalidRequest
from taskrpc.spi import names

_CURLY = "\u201c\u201d\u201e\u2018\u2019\u201a"
_WINDOWS_PATH = re.compile(r"[A-Za-z]:[/\\].*?(?P<rest>[^/\\]*)")
_COLON_EQUALS = re.compile(r"([A-Za-z_][\w.]*):=")
_NO_SPACE = re.compile(r"\{?\s*[\"']?(?P<name>[A-Za-z_]\w*)[\"']?:(?P<value>[^\s:].*?)\}?", re.S)

ONE_ARGUMENT = 'put the request in double quotes, "{a: 2, b: 3}", or write fields as a=2 b=3'


class NotAMapping(InvalidRequest):
    """A request that is a list, a number or a word."""


def not_populated(problem: object) -> InvalidRequest:
    """Return the error for a request that does not fit its type, with ros2's text."""
    return InvalidRequest("", f"Failed to populate field: {problem}")


def name_hint(name: str) -> str:
    """Return a hint for a name that Git Bash turned into a Windows path, or ""."""
    found = _WINDOWS_PATH.fullmatch(name)
    if found is None:
        return ""
    return (
        "Git Bash turns an argument that begins with a slash into a Windows path;"
        f" write {found['rest']} without it, or set MSYS_NO_PATHCONV=1"
    )


def expanded(name: str, *, kind: str = "service name") -> str:
    """Return the absolute name. Raises InvalidName, with a hint if a shell changed the name."""
    try:
        return names.expand(name, kind=kind)
    except InvalidName as error:
        raise hinted(error, name_hint(name)) from None


def request_hint(values: Sequence[str]) -> str:
    """Return a hint for a request that a shell has changed, or ""."""
    if any(begins_curly(value) for value in values):
        return "replace the curly quotation marks (of a word processor) with straight ones"
    if found := _COLON_EQUALS.match(values[0]):
        plain = " ".join(_COLON_EQUALS.sub(r"\1=", value) for value in values)
        return f"{found[1]}:= is for parameters and remappings; write {plain}"
    if values[0].startswith("'"):
        return f"cmd does not support single quotes: {ONE_ARGUMENT}"
    if all(_NO_SPACE.fullmatch(value) for value in values):
        return missing_space_hint(values[0])
    if len(values) > 1 and "=" in values[0]:
        return f'put a value with spaces in double quotes, "{" ".join(values[:2])}"'
    return ONE_ARGUMENT if len(values) > 1 else ""


def field_hint(key: str) -> str:
    """Return a hint for a key without a value."""
    if _NO_SPACE.fullmatch(key):
        return missing_space_hint(key)
    return (
        f"expected a field, got {key}; a value with a comma needs quotes, and PowerShell 5.1"
        " removes quotes inside other quotes: write it as FIELD=VALUE"
    )


def missing_space_hint(text: str) -> str:
    """Return a hint for a text such as `a:2`, which lacks a space after the colon."""
    found = _NO_SPACE.fullmatch(text)
    example = f"{found['name']}: {found['value']}" if found else "a: 2"
    return f"write a space after the colon, {{{example}}}"


def begins_curly(text: str) -> bool:
    """Whether a value begins with a curly quotation mark, which shells and YAML do not know."""
    return text.lstrip()[:1] in tuple(_CURLY)
