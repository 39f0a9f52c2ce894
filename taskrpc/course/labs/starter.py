"""The starter files of a lab: writes them for a student, and remembers which lab it is."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from taskrpc.course.labs.lab import Lab
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError

_FILES = Path(__file__).parent / "files"
_PLACEHOLDER = re.compile(r"@([A-Z][A-Z_0-9]*)@")
RECORD = "taskrpc-lab.json"
"""The file that says which lab a folder contains, and for which variant."""


def starter_files(lab: Lab, variant: Variant) -> dict[str, str]:
    """Return the text of each starter file, by its path in the student's folder."""
    values = lab.values(variant)
    folder = _FILES / f"lab{lab.number}"
    return {
        filled(name, values): filled((folder / name).read_text(encoding="utf-8"), values)
        for name in lab.files
    }


def filled(text: str, values: Mapping[str, str]) -> str:
    """Replace each `@NAME@` in a text by its value."""
    return _PLACEHOLDER.sub(lambda found: values[found[1]], text)


def write_starter(lab: Lab, variant: Variant, folder: Path) -> list[Path]:
    """Write the starter files of a lab into a folder; returns their paths.

    Raises TaskRpcError, and writes nothing, if one of the files exists already.
    """
    texts = {folder / name: text for name, text in starter_files(lab, variant).items()}
    if taken := [path for path in texts if path.exists()]:
        raise TaskRpcError(
            f"{taken[0]} exists already: start the lab in an empty folder, or delete your files"
            " of the lab to begin again"
        )
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
    record = {"lab": lab.number, "variant": variant.id}
    (folder / RECORD).write_text(json.dumps(record) + "\n", encoding="utf-8")
    return list(texts)


def read_record(folder: Path) -> tuple[int, str] | None:
    """Return the number of the lab in a folder and the ID of its variant; None without a record.

    Raises TaskRpcError if the record is damaged.
    """
    path = folder / RECORD
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        id = str(found["variant"])
        id.encode()  # JSON can contain halves of characters, which no text can
        return int(found["lab"]), id
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise TaskRpcError(
            f'{path} is damaged ({error}); expected {{"lab": 1, "variant": ""}}: write it anew'
        ) from None
