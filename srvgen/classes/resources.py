"""What `importlib.resources` finds in the folders of a package of definitions."""

from __future__ import annotations

from importlib.resources.abc import Traversable, TraversableResources
from importlib.resources.readers import MultiplexedPath
from pathlib import Path


class FolderReader(TraversableResources):
    """Reads the files of a package's folders, as Python does for packages without an `__init__`."""

    def __init__(self, folders: list[str]) -> None:
        self.folders = folders

    def files(self) -> Traversable:
        """All folders as one."""
        return MultiplexedPath(*map(Path, self.folders))
