"""The SHA-256 of each wheel of a bundle, in a file of the format of `sha256sum`."""

from __future__ import annotations

import contextlib
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
    try:
        wanted, wrong = _compared(folder)
    except (OSError, UnicodeDecodeError):
        raise TaskRpcError(f"{folder / SUMS} cannot be read; make the bundle again") from None
    problems = [f"{name} is missing" for name in wanted if not (folder / name).exists()]
    problems += [f"{file.name} was added" for file in wrong if file.name not in wanted]
    problems += [f"{file.name} has changed" for file in wrong if file.name in wanted]
    if problems:
        raise TaskRpcError(f"{folder}: {'; '.join(problems)}; make the bundle again")


def remove_wrong(folder: Path) -> None:
    """Delete what `check_sums` refuses, and the checksums, before the wheels are made again."""
    with contextlib.suppress(FileNotFoundError, UnicodeDecodeError):  # nothing was complete
        for file in _compared(folder)[1]:
            file.unlink()
    (folder / SUMS).unlink(missing_ok=True)


def _compared(folder: Path) -> tuple[dict[str, str], list[Path]]:
    """Return the checksums by name, and the files that were added or have changed."""
    lines = (folder / SUMS).read_text(encoding="utf-8").splitlines()
    wanted = {name: value for value, _, name in (line.partition("  ") for line in lines if line)}
    files = sorted(file for file in folder.iterdir() if not file.name.startswith("."))
    wrong = [file for file in files if file.name != SUMS and sum_of(file) != wanted.get(file.name)]
    return wanted, wrong


def sum_of(path: Path) -> str:
    """Return the SHA-256 of a file, as `sha256sum` writes it."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise TaskRpcError(f"{path} cannot be read: {error.strerror}") from None
