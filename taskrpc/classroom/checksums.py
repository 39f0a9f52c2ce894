"""The SHA-256 of each wheel of a bundle, in a file of the format of `sha256sum`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from taskrpc.errors import TaskRpcError

SUMS: Final = "SHA256SUMS"
"""The file with the checksums, beside the wheels."""


def write_sums(folder: Path) -> None:
    """Write the checksums of the wheels of a folder."""
    text = "".join(f"{sum_of(wheel)}  {wheel.name}\n" for wheel in sorted(folder.glob("*.whl")))
    (folder / SUMS).write_text(text, encoding="utf-8", newline="\n")


def check_sums(folder: Path) -> None:
    """Raise TaskRpcError for a wheel that differs from its checksum, is missing or was added.

    Other files are refused too: pip would run the code of a source archive.
    """
    path = folder / SUMS
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        raise TaskRpcError(f"{path} cannot be read; make the bundle again") from None
    wanted = {name: value for value, _, name in (line.partition("  ") for line in lines if line)}
    files = sorted(file for file in folder.iterdir() if not file.name.startswith("."))
    found = {file.name: file for file in files if file.name != SUMS}
    problems = [f"{name} is missing" for name in wanted if name not in found]
    problems += [f"{name} was added" for name in found if name not in wanted]
    problems += [
        f"{name} has changed"
        for name, wheel in found.items()
        if name in wanted and sum_of(wheel) != wanted[name]
    ]
    if problems:
        raise TaskRpcError(f"{folder}: {'; '.join(problems)}; make the bundle again")


def sum_of(path: Path) -> str:
    """Return the SHA-256 of a file, as `sha256sum` writes it."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise TaskRpcError(f"{path} cannot be read: {error.strerror}") from None
