"""Makes the notebooks tidy after a change: starter files as in the labs, no outputs, one format.

Run it with `python -m tests.notebooks.tidy`. A cell that begins with `%%lab FILE` gets the
text of this starter file; files that are not part of the lab stay as they are.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.starter import starter_files
from taskrpc.course.labs.variants import Variant

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "teach" / "notebooks"


def tidy(number: int, text: str) -> str:
    """Return a notebook's text without outputs, with the starter files of its lab."""
    notebook = json.loads(text)
    starters = starter_files(lab(number), Variant())
    for position, cell in enumerate(notebook["cells"], 1):
        _tidy_cell(cell, starters)
        cell["id"] = f"lab{number}-{position:02}"
    notebook["metadata"] = {
        "kernelspec": {
            "display_name": "Python 3 (ipykernel)",
            "language": "python",
            "name": "python3",
        },
        "language_info": {"name": "python"},
    }
    notebook["nbformat"], notebook["nbformat_minor"] = 4, 5
    return json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def _tidy_cell(cell: dict[str, Any], starters: dict[str, str]) -> None:
    tags = cell["metadata"].get("tags")
    cell["metadata"] = {"tags": tags} if tags else {}
    source = "".join(cell["source"])
    if cell["cell_type"] == "code":
        cell["execution_count"], cell["outputs"] = None, []
        first = source.partition("\n")[0]
        starter = starters.get(first.removeprefix("%%lab "))
        if first.startswith("%%lab ") and starter is not None:
            source = f"{first}\n{starter.rstrip()}"
    cell["source"] = source.splitlines(keepends=True)


def main() -> None:
    """Tidy all notebooks."""
    for path in sorted(NOTEBOOKS.glob("lab*.ipynb")):
        number = int(path.stem.removeprefix("lab"))
        path.write_text(tidy(number, path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
