"""The source distribution has what its tests import and read, so that they start there, too."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
HATCH = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]
INCLUDED = {name.strip("/") for name in HATCH["build"]["targets"]["sdist"]["include"]}
ALWAYS = {"pyproject.toml", ".gitignore"}
"""What hatchling adds by itself."""
CACHES = {".mypy_cache"}
"""What tests use if an earlier run has made it."""
NEEDS = re.compile(r'^ *(?:from|import) (\w+)|\bROOT / "([^"/]+)', re.MULTILINE)
"""The first part of an import, or of a path below the top of the checkout."""


def needed_by(folder: Path) -> set[str]:
    """What the Python files of a folder need from the top of the checkout."""
    found: set[str] = set()
    for path in folder.rglob("*.py"):
        found.update(*NEEDS.findall(path.read_text(encoding="utf-8", errors="replace")))
    return {name for name in found - {""} if (ROOT / name).exists()}


def test_source_distribution_has_what_its_tests_import_and_read():
    needed = needed_by(ROOT / "tests")
    assert {"tests", "taskrpc", "srvgen", "benchmarks", "docs", "README.md"} <= needed
    assert needed - INCLUDED - ALWAYS - CACHES == set()
