"""The parser of XML launch files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from launch.frontend.parser import Parser as _Parser

from .entity import Entity, read_xml


class Parser(_Parser):
    """Reads XML launch files."""

    @classmethod
    def load(cls, file: Any) -> tuple[Entity, Parser]:
        """Read a file, given by its path or open; returns its outermost element and a parser."""
        if hasattr(file, "read"):
            return read_xml(file.read(), getattr(file, "name", "launch file")), cls()
        return read_xml(Path(file).read_bytes(), str(file)), cls()

    @classmethod
    def get_file_extensions(cls) -> set[str]:
        """The suffixes of such files."""
        return {"xml"}
