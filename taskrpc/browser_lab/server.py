"""Serves the page on this machine: files from memory, and nothing else."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final

from taskrpc import platform
from taskrpc.errors import CannotListen

PORT: Final = 8737
"""The default port; it is always the same, because browsers keep the students' files for it."""

HOST: Final = "127.0.0.1"

CONTENT_SECURITY_POLICY: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self';"
    " connect-src 'self'; style-src 'self'; img-src 'self' data:; base-uri 'none';"
    " form-action 'none'; frame-ancestors 'none'"
)
"""The page loads its own files only; `wasm-unsafe-eval` allows WebAssembly, not `eval`."""

# Not those of the system: on Windows, programs may have changed the types of scripts.
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".mjs": "text/javascript; charset=utf-8",
    ".wasm": "application/wasm",
}


class LabServer(ThreadingHTTPServer):
    """A web server with the files of `site.site_files`; `serve_forever` serves them."""

    daemon_threads = True

    def __init__(self, files: Mapping[str, bytes], port: int = PORT) -> None:
        pages = {f"/{name}": _Page.of(name, data) for name, data in files.items()}
        pages["/"] = pages["/index.html"]
        try:
            super().__init__((HOST, port), partial(_Handler, pages))
        except OSError as error:
            reason = platform.reason_of(error)
            raise CannotListen(
                f"{HOST}:{port}: {reason}; if the page of the labs is open already, use it, or"
                " choose another port with --port"
            ) from None
        self.url = f"http://{HOST}:{self.server_port}/"


class _Page:
    """One file as a response."""

    def __init__(self, kind: str, data: bytes) -> None:
        self.kind = kind
        self.data = data
        self.tag = f'"{hashlib.sha256(data).hexdigest()[:32]}"'

    @classmethod
    def of(cls, name: str, data: bytes) -> _Page:
        suffix = name[name.rfind(".") :]
        return cls(_TYPES.get(suffix) or "application/octet-stream", data)


class _Handler(BaseHTTPRequestHandler):
    server_version = "taskrpc"
    sys_version = ""
    protocol_version = "HTTP/1.1"
    timeout = 30

    def __init__(self, pages: Mapping[str, _Page], *connection: object) -> None:
        self._pages = pages
        super().__init__(*connection)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        self._respond(with_body=True)

    def do_HEAD(self) -> None:
        self._respond(with_body=False)

    def _respond(self, *, with_body: bool) -> None:
        page = self._pages.get(self.path.partition("?")[0])
        if page is None:
            self._send(HTTPStatus.NOT_FOUND, _Page("text/plain", b"not found\n"), with_body)
        elif self.headers.get("If-None-Match") == page.tag:
            self._send(HTTPStatus.NOT_MODIFIED, _Page(page.kind, b""), False, page.tag)
        else:
            self._send(HTTPStatus.OK, page, with_body, page.tag)

    def _send(self, status: HTTPStatus, page: _Page, with_body: bool, tag: str = "") -> None:
        self.send_response(status)
        self.send_header("Content-Type", page.kind)
        self.send_header("Content-Length", str(len(page.data)))
        self.send_header("Cache-Control", "no-cache")  # ask each time: an update must be seen
        if tag:
            self.send_header("ETag", tag)
        self.send_header("Content-Security-Policy", CONTENT_SECURITY_POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        if with_body:
            self.wfile.write(page.data)

    def log_message(self, *_: object) -> None:
        """Write no line for each request."""
