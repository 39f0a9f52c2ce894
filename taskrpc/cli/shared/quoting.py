"""What shells do to a request on its way to us, and how to type it so that it arrives whole.

bash and PowerShell take quotes away; cmd keeps single ones and splits at the spaces inside;
PowerShell 5.1 drops the double quotes inside single ones; bash turns `{a:1,b:2}` into two words;
Git Bash turns what begins with a slash into a Windows path.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from taskrpc import names
from taskrpc.cli.shared.command import hinted
from taskrpc.errors import InvalidName, InvalidRequest

_CURLY = "\u201c\u201d\u201e\u2018\u2019\u201a"
_WINDOWS_PATH = re.compile(r"[A-Za-z]:[/\\].*?(?P<rest>[^/\\]*)")
_COLON_EQUALS = re.compile(r"([A-Za-z_][\w.]*):=")
_NO_SPACE = re.compile(r"\{?\s*[\"']?(?P<name>[A-Za-z_]\w*)[\"']?:(?P<value>[^\s:].*?)\}?", re.S)

ONE_ARGUMENT = 'put the request in double quotes, "{a: 2, b: 3}", or write fields as a=2 b=3'


class NotAMapping(InvalidRequest):
    """A request that is a list, a number or a word."""


def not_populated(problem: object) -> InvalidRequest:
    """The error for a request that does not fit its type, in ros2's words."""
    return InvalidRequest("", f"Failed to populate field: {problem}")


def name_hint(name: str) -> str:
    """What became of a name that is a Windows path now, or ""."""
    found = _WINDOWS_PATH.fullmatch(name)
    if found is None:
        return ""
    return (
        "Git Bash turns an argument that begins with a slash into a Windows path;"
        f" write {found['rest']} without it, or set MSYS_NO_PATHCONV=1"
    )


def expanded(name: str, *, kind: str = "service name") -> str:
    """The absolute name that is meant. Raises InvalidName, with what a shell did to it."""
    try:
        return names.expand(name, kind=kind)
    except InvalidName as error:
        raise hinted(error, name_hint(name)) from None


def request_hint(values: Sequence[str]) -> str:
    """What became of a request that no shell delivers unless something went wrong, or ""."""
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
        return f'a value with spaces stands in double quotes, "{" ".join(values[:2])}"'
    return ONE_ARGUMENT if len(values) > 1 else ""


def field_hint(key: str) -> str:
    """Why a mapping may have a key without a value, or ""."""
    if _NO_SPACE.fullmatch(key):
        return missing_space_hint(key)
    return (
        f"{key} stands where a field was expected; a value with a comma needs quotes, and"
        " PowerShell 5.1 takes those inside others away: write it as FIELD=VALUE"
    )


def missing_space_hint(text: str) -> str:
    """How `a:2` is written."""
    found = _NO_SPACE.fullmatch(text)
    example = f"{found['name']}: {found['value']}" if found else "a: 2"
    return f"write a space after the colon, {{{example}}}"


def begins_curly(text: str) -> bool:
    """Whether a value begins with a quotation mark that no shell and no YAML knows."""
    return text.lstrip()[:1] in tuple(_CURLY)
