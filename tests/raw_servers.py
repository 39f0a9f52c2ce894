"""Servers of other protocols than taskrpc's, which talk to each caller in a thread."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator

_POLL = 0.05
"""Seconds between two looks whether the block has ended."""
_PATIENCE = 2.0
"""Seconds that a caller may be silent."""


@contextlib.contextmanager
def served(sock: socket.socket, talk: Callable[[socket.socket], object]) -> Iterator[str]:
    """Do `talk(connection)` with each caller of a listening socket; yields its HOST:PORT or path.

    The thread ends with the block. One that is left in `accept` would keep the port open, and could
    take the connections of a later socket that gets the same descriptor.
    """
    ended = threading.Event()
    sock.settimeout(_POLL)

    def serve() -> None:
        while not ended.is_set():
            with contextlib.suppress(OSError):  # no caller yet, or it has closed the connection
                connection, _ = sock.accept()
                with connection:
                    connection.settimeout(_PATIENCE)
                    talk(connection)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        name = sock.getsockname()
        yield name if isinstance(name, str) else f"{name[0]}:{name[1]}"
    finally:
        ended.set()
        thread.join()
        sock.close()
