"""`taskrpc view --lab`: serves the page on which the labs run in a browser tab."""

from __future__ import annotations

import argparse
import signal
import sys
import webbrowser
from pathlib import Path

from taskrpc.cli.shared.command import Exit, UsageError
from taskrpc.course.browser_lab.downloads import runtime
from taskrpc.course.browser_lab.exercises import exercises
from taskrpc.course.browser_lab.server import PORT, LabServer
from taskrpc.course.browser_lab.site import site_files


def view(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C. Raises TaskRpcError."""
    numbers = [exercise["number"] for exercise in exercises()]
    if options.lab not in numbers:
        raise UsageError(
            f"--lab: expected one of {', '.join(map(str, numbers))}, got {options.lab};"
            " `taskrpc lab start N` starts the other labs, outside of the browser"
        )
    files = files_of_the_page(options.pyodide, options.variant or "")
    with LabServer(files, PORT if options.port is None else options.port) as server:
        link = server.url if options.lab == 1 else f"{server.url}?lab={options.lab}"
        if options.no_browser or not webbrowser.open(link):
            print(link, flush=True)
        _report(f"the page of the labs is at {link}; Ctrl-C ends it")
        return serve(server)


def files_of_the_page(pyodide: str | None, variant: str = "") -> dict[str, bytes]:
    """Return the files of the page, with Pyodide from a folder or the internet.

    Raises TaskRpcError.
    """
    folder = None if pyodide is None else Path(pyodide)
    archives = runtime(folder, lambda file: _report(f"downloading {file}"))
    return site_files(archives, variant)


def serve(server: LabServer) -> Exit:
    """Serve the page until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    return Exit.DONE


def _report(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
