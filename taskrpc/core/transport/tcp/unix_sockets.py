"""Unix sockets: calls within this machine; the system tells which user a caller is."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

from taskrpc.core.system import file_locks, folders, private_files
from taskrpc.core.wire.handshake import PeerCredentials
from taskrpc.errors import CannotListen, PermissionDenied, TaskRpcError

PREFIX = "unix:"

_SOL_LOCAL, _LOCAL_PEERCRED = 0, 1  # macOS: the user at the other end of a unix socket
_XUCRED = 76  # bytes of its value: version, user id, groups

_PROBE_TIMEOUT = 1.0
"""Seconds in which an existing server must accept a connection."""


def is_unix(address: str) -> bool:
    """Whether an address is `unix:/path`."""
    return address.startswith(PREFIX)


def checked_unix(address: str) -> str:
    """Return the address with an absolute path.

    Raises TaskRpcError without a path, or if Python has no Unix sockets here.
    """
    if not hasattr(socket, "AF_UNIX"):
        raise TaskRpcError(f"{address}: Python has no unix sockets on Windows; use 127.0.0.1:PORT")
    if address == PREFIX:
        raise TaskRpcError("expected unix:/path of the server's socket, got unix: alone")
    return PREFIX + os.path.abspath(address.removeprefix(PREFIX))


def path_of(address: str) -> str:
    """Return the path in `unix:/path`. Raises TaskRpcError if Python has no Unix sockets here."""
    return checked_unix(address).removeprefix(PREFIX)


def bound_unix(address: str, name: str) -> tuple[socket.socket, str, os.stat_result]:
    """Return a listening socket that only this user can reach, its path, and its file's status.

    `unix:` alone means a socket of this name in the runtime folder. The socket file of a dead
    server is replaced. Raises CannotListen, also if a living server has the path.
    """
    own = address == PREFIX
    path = Path(path_of(address)) if not own else folders.runtime_dir() / name
    try:
        with _locked_folder(path) as folder:
            _clear(path, folder)
            return _bound(path, folder), str(path), _status(path, folder)
    except OSError as error:
        raise CannotListen(f"cannot listen at {PREFIX}{path}: {error.strerror or error}") from None
    except TaskRpcError as error:
        raise CannotListen(f"cannot listen at {PREFIX}{path}: {error}") from None


def remove_unix(path: str, made: os.stat_result) -> None:
    """Remove the files of a listening socket, unless another server has replaced them."""
    file = Path(path)
    with contextlib.suppress(OSError, TaskRpcError), _locked_folder(file) as folder:
        os.unlink(_lock_of(file), dir_fd=folder)
        found = _status(file, folder)
        # The inode alone is not enough: the file system may have reused it for another file.
        if os.path.samestat(found, made) and found.st_mtime_ns == made.st_mtime_ns:
            os.unlink(file.name, dir_fd=folder)


def peer_user(sock: socket.socket) -> int | None:
    """Return the user id of the program at the other end of a Unix socket, None if unknown."""
    if hasattr(socket, "SO_PEERCRED"):
        found = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        return int(struct.unpack("3i", found)[1])
    if sys.platform == "darwin":
        credentials = sock.getsockopt(_SOL_LOCAL, _LOCAL_PEERCRED, _XUCRED)
        return int(struct.unpack_from("2I", credentials)[1])
    else:
        return None


def unix_peer_credentials(
    sock: socket.socket, *, serving: bool, has_accounts: bool
) -> PeerCredentials | None:
    """Return what the system knows about the peer: whether it belongs to this user or to root.

    Raises PermissionDenied if a program of another user calls a server without accounts.
    """
    uid = peer_user(sock)
    if uid is not None and (uid == 0 or private_files.is_this_user(uid)):
        return PeerCredentials("", is_owner=True)
    if serving and not has_accounts:
        raise PermissionDenied("this socket is for programs of its own user only")
    return None


def _lock_of(path: Path) -> str:
    return f".{path.name}.lock"


@contextlib.contextmanager
def _locked_folder(path: Path) -> Iterator[int]:
    """Open the folder of a socket, check that only this user can enter it, and hold its lock.

    Another user may be able to put another folder in its place. So files are removed and changed
    only through the descriptor, which this yields. Raises TaskRpcError and OSError.
    """
    folder = private_files.open_checked_dir(path.parent)
    try:
        lock = private_files.open_private(_lock_of(path), dir_fd=folder)
        try:
            file_locks.lock(lock)
            yield folder
        finally:
            os.close(lock)
    finally:
        os.close(folder)


def _status(path: Path, folder: int) -> os.stat_result:
    return os.stat(path.name, dir_fd=folder, follow_symlinks=False)


def _clear(path: Path, folder: int) -> None:
    """Remove the socket of a dead server."""
    try:
        found = _status(path, folder)
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found.st_mode):
        raise TaskRpcError("a file that is not a socket exists there")
    with _unix_socket() as probe:
        probe.settimeout(_PROBE_TIMEOUT)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            os.unlink(path.name, dir_fd=folder)
            return
        except OSError as error:  # for example a full backlog: the server lives
            raise TaskRpcError(f"a server is there: {error.strerror or error}") from None
    raise TaskRpcError("another server listens there")


def _unix_socket() -> socket.socket:
    if sys.platform == "win32":
        raise TaskRpcError("Python has no unix sockets on Windows")
    else:
        return socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)


def _bound(path: Path, folder: int) -> socket.socket:
    from taskrpc.core.transport.tcp.listening import BACKLOG

    sock = _unix_socket()
    try:
        sock.bind(str(path))
        # The umask may allow more; until this call, the private folder keeps other users out.
        private_files.set_mode(path.name, 0o600, dir_fd=folder)
        sock.listen(BACKLOG)
        sock.setblocking(False)
    except BaseException:
        sock.close()
        raise
    return sock
