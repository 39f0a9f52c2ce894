"""`taskrpc classroom lab`: serves the labs in a browser tab to laptops that have no Python."""

from __future__ import annotations

import argparse
import sys

from taskrpc import Tls
from taskrpc.cli.course.lab.browser_page import files_of_the_page, serve
from taskrpc.cli.shared.command import Exit
from taskrpc.course.browser_lab.server import PORT, LabServer
from taskrpc.course.classroom.register import Register

_EVERYWHERE = "0.0.0.0"


def serve_to_class(register: Register, options: argparse.Namespace) -> Exit:
    """Serve the page to all networks until Ctrl-C, with the certificate of the class.

    Raises TaskRpcError if there is no class, or the page has no Pyodide.
    """
    class_server, made = register.server, register.certificates
    files = files_of_the_page(options.pyodide)
    context = Tls(cert=made.cert, key=made.key).server_context()
    port = PORT if options.port is None else options.port
    with LabServer(files, port, host=_EVERYWHERE, context=context) as server:
        _say("on each laptop, open this address in a browser:")
        for host in class_server.hosts:
            print(server.url_at(host), flush=True)
        _say(
            "the browser warns, because it does not know the class's certificate; continue if the"
            " certificate's SHA-256 fingerprint is"
        )
        _say(made.fingerprint.hex(":").upper())
        _say("Ctrl-C ends the page")
        return serve(server)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
