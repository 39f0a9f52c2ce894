"""Packages of others, as pip would install them: their modules and entry points in one folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def add_package(
    folder: Path, name: str, modules: Mapping[str, str], points: Mapping[str, Mapping[str, str]]
) -> None:
    """Write the modules and the metadata of a package into a folder that Python searches.

    Args:
        folder: the folder.
        name: the name of the package.
        modules: the text of each module.
        points: the entry points of each group.
    """
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text, encoding="utf-8")
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
    (info / "METADATA").write_text(metadata, encoding="utf-8")
    lines = []
    for group, entries in points.items():
        lines += [f"[{group}]", *(f"{point} = {value}" for point, value in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
