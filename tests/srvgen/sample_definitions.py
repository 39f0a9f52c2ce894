"""Writes definitions and other files for tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def put(name: str, text: str, folder: Path = Path()) -> Path:
    """Write the definition of a full name (`my_msgs/srv/Fetch`) where its package would have it."""
    path = folder / f"{name}.{name.split('/')[1]}"
    put_all({path.name: text}, path.parent)
    return path


def put_all(texts: Mapping[str, str], folder: Path) -> None:
    """Write files by their paths below a folder, to the letter."""
    for relative, text in texts.items():
        path = folder / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="")
