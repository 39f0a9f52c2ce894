"""Whether a program said what a page shows, figures that differ from run to run left aside."""

from __future__ import annotations

import os
import re

_FIGURES = (
    (r"\b127\.0\.0\.1:\d+", "127.0.0.1:PORT"),
    (r"\b(pid|taskrpc stop) \d+", r"\1 NUMBER"),
    (r"_taskrpc_cli_\d+", "_taskrpc_cli_NUMBER"),
    (r"\b\d\d:\d\d:\d\d\b", "TIME"),
    (r"\b\d{4}-\d\d-\d\d\b", "DATE"),
    (r"\[\d{9,}\.\d+\]", "[STAMP]"),
    (r"\b\d+\.\d{4,}(?:e-?\d+)?\b", "FLOAT"),
    # How much longer a task waits for another one depends on the tasks only.
    (r"\b\d+\.\d s\b(?!: task \d+, priority \d+, went ahead)", "SECONDS"),
    (r"(?<=\S) {2,}", "  "),  # columns are as wide as such figures
)


def normalised(text: str) -> str:
    """The text with every figure of a run replaced by its kind."""
    text = text.replace(os.sep, "/")
    for pattern, kind in _FIGURES:
        text = re.sub(pattern, kind, text)
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines())


def pattern_of(expected: str) -> re.Pattern[str]:
    """What a program's normalised output must match: `…` stands for anything.

    Within a line it stands for the rest of a word or more, alone in a line for any lines.
    """
    lines = normalised(expected).splitlines()
    parts = [r"(?:.*\n)*?" if line.strip() == "…" else _line(line) + r"\n" for line in lines]
    return re.compile("".join(parts))


def _line(line: str) -> str:
    return re.escape(line).replace("…", "[^\n]*")
