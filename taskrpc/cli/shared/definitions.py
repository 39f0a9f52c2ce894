"""Definitions as commands look for them: in the workspace around the working directory first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import srvgen
from srvgen.classes.loader import search_first
from srvgen.files.search import Search


def search() -> Search:
    """Looks in the packages of the workspace here before it looks elsewhere."""
    return Search(_roots())


def load(type_name: str) -> Any:
    """The class of a type. Raises DefinitionError."""
    search_first(_roots())
    return srvgen.load(type_name)


def _roots() -> list[Path]:
    from taskrpc.ros import workspace

    return workspace.roots(Path.cwd())
