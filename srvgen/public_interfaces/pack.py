"""Packs the packages beside this file into `srvgen/interfaces.zip`.

Run it as `python srvgen/public_interfaces/pack.py`.

Run it after each change of a definition. Equal definitions give equal bytes with one version of
zlib.
"""

from __future__ import annotations

import sys
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

SOURCE = Path(__file__).parent
sys.path.insert(0, str(SOURCE.parents[1]))

from srvgen.files.archive import ARCHIVE, joined  # noqa: E402


def packages() -> dict[str, dict[str, str]]:
    """The texts of all definitions, by package and by the name of the file."""
    found: dict[str, dict[str, str]] = {}
    for path in sorted(SOURCE.glob("*/*/*")):
        package, kind, name = path.relative_to(SOURCE).parts
        if name.endswith(f".{kind}"):
            text = path.read_text(encoding="utf-8").rstrip("\n")
            found.setdefault(package, {})[f"{kind}/{name}"] = f"{text}\n" if text else ""
    return found


def main() -> None:
    """Write the archive."""
    found = packages()
    entries = {"packages.txt": "\n".join(found)}
    entries |= {f"{package}.txt": joined(texts) for package, texts in found.items()}
    with ZipFile(ARCHIVE, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name, text in entries.items():
            info = ZipInfo(name)  # with a fixed date, so that equal texts give an equal archive
            info.compress_type = ZIP_DEFLATED
            archive.writestr(info, text)
    print(f"{len(found)} packages, {ARCHIVE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
