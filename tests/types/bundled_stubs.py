"""The stubs that are committed: `python -m tests.types.bundled_stubs` writes them again.

`srvgen/stubs` is installed with srvgen. `typings` beside this file is for our own checks: our ROS
programs import the same classes under their names in ROS.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from srvgen.classes.stubs import BUNDLED_STUBS, bundled_stubs, packages_with_dependencies
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put_all

ROOT = Path(__file__).parents[2]
FOLDERS = ROOT / "srvgen" / "stubs", ROOT / "tests" / "types" / "typings"


def expected() -> dict[str, str]:
    """Return the texts of all committed stubs, by path relative to the checkout."""
    names = sorted(path.name for path in BUNDLED.iterdir() if path.is_dir())
    definitions, problems = packages_with_dependencies(names, Search([BUNDLED]))
    assert not problems, problems
    files = {f"srvgen/stubs/{path}": text for path, text in bundled_stubs(definitions).items()}
    for package, kind in sorted({tuple(name.split("/")[:2]) for name in definitions}):
        text = f"from {BUNDLED_STUBS}{package}.{kind} import *\n"
        files[f"tests/types/typings/{package}/{kind}.pyi"] = text
    return files


def committed() -> dict[str, str]:
    """Return the texts of the files in the folders, likewise."""
    return {
        path.relative_to(ROOT).as_posix(): path.read_text("utf-8")
        for folder in FOLDERS
        for path in folder.rglob("*.pyi")
    }


if __name__ == "__main__":
    for folder in FOLDERS:
        shutil.rmtree(folder, ignore_errors=True)
    put_all(expected(), ROOT)
