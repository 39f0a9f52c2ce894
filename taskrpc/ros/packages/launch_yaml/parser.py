"""The parser of YAML launch files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from launch.frontend.parser import Parser as _Parser

from .entity import Entity, read_yaml


class Parser(_Parser):
    """Reads YAML launch files."""

    @classmethod
    def load(cls, file: Any) -> tuple[Entity, Parser]:
        """Read a file, given by its path or open; returns its outermost element and a parser."""
        if hasattr(file, "read"):
            return read_yaml(file.read(), getattr(file, "name", "launch file")), cls()
        return read_yaml(Path(file).read_text("utf-8"), str(file)), cls()

    @classmethod
    def get_file_extensions(cls) -> set[str]:
        """The suffixes of such files."""
        return {"yaml", "yml"}
