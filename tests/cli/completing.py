"""What the TAB key completes in a line."""

from __future__ import annotations

import functools
import io

import argcomplete
import pytest

from taskrpc.cli.main import main


def completed(line, monkeypatch):
    """Return what argcomplete prints; it uses no file descriptors of its own, as pytest does."""
    printed = io.StringIO()
    complete = functools.partial(argcomplete.autocomplete, output_stream=printed)
    monkeypatch.setattr(argcomplete, "autocomplete", complete)
    monkeypatch.setattr(argcomplete.CompletionFinder, "_init_debug_stream", lambda self: None)
    typed = f"taskrpc {line}"
    for name, value in (
        ("_ARGCOMPLETE", "1"),
        ("_ARGCOMPLETE_IFS", "|"),
        ("_ARGCOMPLETE_SUPPRESS_SPACE", "1"),
        ("COMP_LINE", typed),
        ("COMP_POINT", str(len(typed))),
    ):
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit):
        main([])
    return sorted(filter(None, printed.getvalue().split("|")))
