"""Serves the page, on this machine or to a class: files from memory, and nothing else.

The page contains no secret and gives access to nothing, so it needs no token. In a network it is
served with TLS, so that nobody can change the programs on their way to the students.
"""

from __future__ import annotations

import gzip
import hashlib
import socket
import ssl
import sys
from collections.abc import Mapping
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

from taskrpc.errors import CannotListen
from taskrpc.spi import join_address, os_errors

PORT: Final = 8737
"""The default port; it is always the same, because browsers keep the students' files for it."""

HOST: Final = "127.0.0.1"

_HANDSHAKE = b"\x16"
"""The first byte of a TLS connection; HTTP begins with a letter."""

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
    request_queue_size = 128  # a whole class opens the page at the same time

    def __init__(
        self,
        files: Mapping[str, bytes],
        port: int = PORT,
        *,
        host: str = HOST,
        context: ssl.SSLContext | None = None,
    ) -> None:
        is_remote = context is not None
        pages = {f"/{name}": _Page.of(name, data, packed=is_remote) for name, data in files.items()}
        pages["/"] = pages["/index.html"]
        self._context = context
        try:
            super().__init__((host, port), partial(_Handler, pages))
        except OSError as error:
            reason = os_errors.reason_of(error)
            raise CannotListen(
                f"{host}:{port}: {reason}; if the page of the labs is open already, use it, or"
                " choose another port with --port"
            ) from None
        self.url = self.url_at(host)

    def url_at(self, host: str) -> str:
        """Return the address of the page at a host of this machine."""
        scheme = "http" if self._context is None else "https"
        return f"{scheme}://{join_address(host, self.server_port)}/"

    def finish_request(self, request: Any, client_address: Any) -> None:
        """Serve one connection, in its own thread; with TLS, redirect plain HTTP."""
        if self._context is None:
            return super().finish_request(request, client_address)
        request.settimeout(_Handler.timeout)
        if request.recv(1, socket.MSG_PEEK) != _HANDSHAKE:
            _Redirect(request, client_address, self)
            return None
        with self._context.wrap_socket(request, server_side=True) as encrypted:
            return super().finish_request(encrypted, client_address)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore connections that break, as when a browser refuses the certificate."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Page:
    """One file as a response."""

    def __init__(self, kind: str, data: bytes, packed: bytes = b"") -> None:
        self.kind = kind
        self.data = data
        self.packed = packed
        """The file with gzip, for browsers of other machines; empty if none is served to them."""
        self.tag = f'"{hashlib.sha256(data).hexdigest()[:32]}"'

    @classmethod
    def of(cls, name: str, data: bytes, *, packed: bool) -> _Page:
        """Return the response for a file; `packed` halves what a class loads."""
        kind = _TYPES.get(name[name.rfind(".") :])
        if kind is None:  # an archive, which is compressed already
            return cls("application/octet-stream", data)
        return cls(kind, data, gzip.compress(data, 6) if packed else b"")


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
        is_packed = page.packed and "gzip" in self.headers.get("Accept-Encoding", "")
        content = page.packed if is_packed else page.data
        self.send_header("Content-Type", page.kind)
        self.send_header("Content-Length", str(len(content)))
        if is_packed:
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Cache-Control", "no-cache")  # ask each time: an update must be seen
        if tag:
            self.send_header("ETag", tag)
        self.send_header("Content-Security-Policy", CONTENT_SECURITY_POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        if with_body:
            self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Write no line for each request."""


class _Redirect(BaseHTTPRequestHandler):
    """Sends a browser that was given the address without `https` to the encrypted page."""

    server_version = "taskrpc"
    sys_version = ""
    timeout = _Handler.timeout

    def do_GET(self) -> None:
        self.send_response(HTTPStatus.TEMPORARY_REDIRECT)
        self.send_header("Location", f"https://{self.headers.get('Host', '')}{self.path}")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Write no line for each request."""
