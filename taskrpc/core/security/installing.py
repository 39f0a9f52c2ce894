"""The command that installs what an extra of taskrpc adds, for the Python that runs this program.

It never names taskrpc: no package index has it, and a stranger could register the name.
"""

from __future__ import annotations

import sys

_UNSAFE_IN_CMD = ' <>&|^()[]*;,%!"'
"""Characters for which the Command Prompt and PowerShell need quotes."""


def install_command(extra: str, package: str) -> str:
    """Return a line for a shell that installs the packages of an extra.

    `package` is the name on the package index, for a taskrpc that runs without being installed.
    """
    from importlib.util import find_spec  # few programs need it

    wanted = _requirements(extra) or [package]
    if environment := _pipx_environment(sys.prefix):
        words = ["pipx", "inject", environment, *wanted]
    elif find_spec("pip") is None:  # uv makes environments without pip
        words = ["uv", "pip", "install", "--python", sys.executable, *wanted]
    else:
        words = [sys.executable, "-m", "pip", "install", *wanted]
    return _quoted(words)


def _requirements(extra: str) -> list[str]:
    """The requirements of an extra, as in `mcap>=1.2`, from the metadata of the installation."""
    from importlib import metadata

    try:
        lines = metadata.requires("taskrpc") or []
    except metadata.PackageNotFoundError:
        return []
    parts = [line.partition(";") for line in lines]
    marks = (f'extra == "{extra}"', f"extra == '{extra}'")
    return [wanted.strip() for wanted, _, marker in parts if marker.strip() in marks]


def _pipx_environment(prefix: str) -> str:
    """The name of the environment if pipx has made it, else ""."""
    *_, above, folder, name = ("", "", *prefix.replace("\\", "/").rstrip("/").split("/"))
    return name if (above, folder) == ("pipx", "venvs") else ""


def _quoted(words: list[str]) -> str:
    if sys.platform == "win32":
        line = " ".join(f'"{each}"' if set(each) & set(_UNSAFE_IN_CMD) else each for each in words)
        # PowerShell takes a quoted word in front for a text; the Command Prompt has no `&` there.
        return f"{line} (PowerShell: & {line})" if line.startswith('"') else line
    else:
        import shlex

        return shlex.join(words)
