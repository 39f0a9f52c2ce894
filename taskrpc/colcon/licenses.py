"""The licences that ROS 2's tools know, and the texts of those that a package can be given here."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

_TEXTS = Path(__file__).with_name("license_texts")

KNOWN = (
    "Apache-2.0",
    "BSL-1.0",
    "BSD-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "GPL-3.0-only",
    "LGPL-2.1-only",
    "LGPL-3.0-only",
    "MIT",
    "MIT-0",
)
"""Their identifiers."""


def license_text(name: str, holder: str) -> str:
    """The text of a licence for what the holder writes now, "" where it is not here."""
    path = _TEXTS / f"{name}.txt"
    if name not in KNOWN or not path.is_file():
        return ""
    text = path.read_text(encoding="utf-8")
    return text.replace("{year}", str(datetime.now(UTC).year)).replace("{holder}", holder)
