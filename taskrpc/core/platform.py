"""The differences between Linux, macOS and Windows, except the socket options of TCP."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import cache

from taskrpc.errors import TaskRpcError

# Every command needs only one or two of these functions. Importing the modules for all of them
# would take most of the time of `taskrpc --help`, so the functions import them.
TYPE_CHECKING = False
if TYPE_CHECKING:
    import socket
    from pathlib import Path
    from typing import Any

_LOCK_OFFSET = 0x7FFF_0000  # far behind the contents: Windows forbids reading locked bytes
_LONGEST_HOLD, _LOCK_RETRY = 10.0, 0.002  # seconds; how long and how often to try a Windows lock
_HELD = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)  # errors for a lock that another process has
_KEY_POLL = 0.1  # seconds between two looks at the keys of a Windows console
_PREFIXES = ("\0", "\xe0")  # of a Windows console's keys that have no character
_NO_LIMIT = 2**20
_LONGEST_TEXT = 16 * 2**20  # bytes
_NO_SUCH_PROCESS = 87  # Windows' ERROR_INVALID_PARAMETER: no process has this id
_REFUSED = 1225  # Windows' ERROR_CONNECTION_REFUSED, from asyncio's proactor
_SOL_LOCAL, _LOCAL_PEERCRED = 0, 1  # macOS: the user at the other end of a unix socket
_XUCRED = 76  # bytes of its value: version, user id, groups


_FOLDER_FLAGS = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0)

program: ContextVar[str] = ContextVar("program", default="")
"""The name of the running program where several share one interpreter, as in a browser tab; else
"". What a process has once, such as its endpoint or rclpy's default context, each of them has."""


def runtime_dir() -> Path:
    """Return the folder for files that last as long as their process; creates it if necessary.

    Only this user can enter it. Raises TaskRpcError if others can, or own it.
    """
    return private_dir(runtime_path())


def runtime_path() -> Path:
    """Return the path of `runtime_dir`, without creating the folder."""
    from pathlib import Path

    if xdg := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(xdg) / "taskrpc"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or _temporary()) / "taskrpc" / "run"
    else:
        return Path(_temporary()) / f"taskrpc-{os.getuid()}"


def _temporary() -> str:
    if sys.platform == "win32":
        import tempfile

        return tempfile.gettempdir()
    else:  # importing tempfile would cost a server's start more than its sockets do
        return os.environ.get("TMPDIR") or "/tmp"


def state_dir() -> Path:
    """Return the folder for files that outlast their process; creates it if necessary.

    The task server's database is there. Only this user can enter the folder. Raises TaskRpcError
    if others can, or own it.
    """
    return private_dir(find_state_dir())


def find_state_dir() -> Path:
    """Return the path of `state_dir`, without creating the folder."""
    from pathlib import Path

    if xdg := os.environ.get("XDG_STATE_HOME"):
        return Path(xdg) / "taskrpc"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "taskrpc"
    elif sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "taskrpc"
    else:
        return Path.home() / ".local" / "state" / "taskrpc"


def cache_dir() -> Path:
    """Return the folder for files that can be downloaded again; creates it if necessary.

    Only this user can enter the folder. Raises TaskRpcError if others can, or own it.
    """
    from pathlib import Path

    if xdg := os.environ.get("XDG_CACHE_HOME"):
        return private_dir(Path(xdg) / "taskrpc")
    if sys.platform == "win32":
        return private_dir(Path(os.environ.get("LOCALAPPDATA") or _temporary()) / "taskrpc/cache")
    elif sys.platform == "darwin":
        return private_dir(Path.home() / "Library" / "Caches" / "taskrpc")
    else:
        return private_dir(Path.home() / ".cache" / "taskrpc")


def private_dir(path: Path) -> Path:
    """Make a folder that only this user can enter, or check that it is one.

    Raises TaskRpcError if it cannot be made, is a link, or belongs to another user.
    """
    if sys.platform != "win32":
        os.close(open_private_dir(path))
        return path
    else:
        try:
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = path.lstat()
        except OSError as error:
            raise TaskRpcError(f"cannot make the folder {path}: {error.strerror}") from None
        if not stat.S_ISDIR(found.st_mode) or is_link(found):
            raise _not_a_folder(path)
        return path


def open_private_dir(path: Path, *, dir_fd: int | None = None) -> int:
    """Make a folder that only this user can enter, or check that it is one; return a descriptor.

    With `dir_fd`, the descriptor of the folder above, only the last name of the path is looked up.
    Not on Windows. Raises TaskRpcError as `private_dir` does.
    """
    name = path if dir_fd is None else path.name
    flags = _FOLDER_FLAGS
    try:
        try:
            descriptor = os.open(name, flags, dir_fd=dir_fd)
        except FileNotFoundError:
            if dir_fd is None:
                path.mkdir(mode=0o700, parents=True, exist_ok=True)
            else:
                with contextlib.suppress(FileExistsError):
                    os.mkdir(name, 0o700, dir_fd=dir_fd)
            descriptor = os.open(name, flags, dir_fd=dir_fd)
    except OSError as error:
        raise _no_folder(path, name, dir_fd, error) from None
    try:
        _check_owner(path, descriptor)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _no_folder(path: Path, name: Path | str, dir_fd: int | None, error: OSError) -> TaskRpcError:
    """Return why a private folder could not be opened."""
    try:
        found = os.stat(name, dir_fd=dir_fd, follow_symlinks=False)
    except OSError:
        return TaskRpcError(f"cannot make the folder {path}: {error.strerror}")
    if not stat.S_ISDIR(found.st_mode):
        return _not_a_folder(path)
    if not is_this_user(found.st_uid):
        return _not_ours(path)
    return TaskRpcError(f"cannot open the folder {path}: {error.strerror}")


def _not_a_folder(path: Path) -> TaskRpcError:
    return TaskRpcError(f"{path}: expected a folder of this user's, found a link or a file")


def _not_ours(path: Path) -> TaskRpcError:
    return TaskRpcError(f"{path}: expected a folder of this user's, it belongs to another user")


def is_link(found: os.stat_result) -> bool:
    """Return whether a status is that of a symbolic link, or of any reparse point of Windows."""
    attributes = getattr(found, "st_file_attributes", 0)
    return stat.S_ISLNK(found.st_mode) or bool(attributes & stat.FILE_ATTRIBUTE_REPARSE_POINT)


def open_checked_dir(path: Path) -> int:
    """Create a folder that only this user can enter, or check an existing one without changing it.

    Returns a descriptor. Not on Windows. Raises TaskRpcError with the remedy, or OSError.
    """
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        descriptor = os.open(path, _FOLDER_FLAGS)
    except OSError as error:
        if error.errno not in (errno.ENOTDIR, errno.ELOOP, errno.EACCES):
            raise
        raise TaskRpcError(f"{path}: expected a folder of this user's") from None
    found = os.fstat(descriptor)
    if is_this_user(found.st_uid) and not found.st_mode & 0o077:
        return descriptor
    os.close(descriptor)
    if not is_this_user(found.st_uid):
        raise TaskRpcError(f"{path}: expected a folder of this user's")
    mode = stat.S_IMODE(found.st_mode)
    raise TaskRpcError(
        f"{path}: expected a folder that only its owner can enter, its mode is {mode:04o};"
        " name a folder of its own"
    )


def peer_user(sock: socket.socket) -> int | None:
    """Return the user id of the program at the other end of a Unix socket, None if unknown."""
    import socket
    import struct

    if hasattr(socket, "SO_PEERCRED"):
        found = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        return int(struct.unpack("3i", found)[1])
    if sys.platform == "darwin":
        credentials = sock.getsockopt(_SOL_LOCAL, _LOCAL_PEERCRED, _XUCRED)
        return int(struct.unpack_from("2I", credentials)[1])
    else:
        return None


def _check_owner(path: Path, descriptor: int) -> None:
    found = os.fstat(descriptor)
    if not is_this_user(found.st_uid):
        raise _not_ours(path)
    if sys.platform != "win32" and found.st_mode & 0o077:
        os.fchmod(descriptor, 0o700)


def is_this_user(uid: int) -> bool:
    """Return whether a user id is that of this program's user.

    Always true on Windows, where files have no user id. There, other users cannot enter the user's
    profile folder.
    """
    if sys.platform == "win32":
        return True
    else:
        return uid == os.getuid()


def is_ours_or_roots(found: os.stat_result) -> bool:
    """Return whether this program's user or root owns a file."""
    return found.st_uid == 0 or is_this_user(found.st_uid)


OPEN_FLAGS = (
    os.O_RDWR
    | getattr(os, "O_BINARY", 0)
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
)
"""How this user's private files are opened: no link is followed, and a pipe does not block."""


def open_private(path: Path | str, *, must_be_new: bool = False, dir_fd: int | None = None) -> int:
    """Open or create a file that only this user can read; returns the descriptor.

    With `dir_fd`, a folder's descriptor, the path is a name in this folder.
    """
    flags = OPEN_FLAGS | os.O_CREAT | (os.O_EXCL if must_be_new else 0)
    return os.open(path, flags, 0o600, dir_fd=dir_fd)


def check_private(descriptor: int, path: object) -> None:
    """Check that only this user, or root, can read or write a file with secrets.

    Raises TaskRpcError with the remedy.
    """
    if problem := why_not_private(descriptor, path):
        raise TaskRpcError(problem)


def why_not_private(descriptor: int, path: object, *, is_key: bool = False) -> str:
    """Return why other users can read or write a file, and the remedy; "" if they cannot.

    Root does not count. A group may read a TLS key that root owns: systems give keys to servers in
    this way.
    """
    found = os.fstat(descriptor)
    if not is_ours_or_roots(found):
        return f"{path}: expected a file of this user's, it belongs to another user"
    readable = found.st_mode & (0o037 if is_key and found.st_uid == 0 else 0o077)
    if sys.platform != "win32" and readable:
        mode = stat.S_IMODE(found.st_mode)
        return (
            f"{path}: expected a file that only its owner can read, its mode is {mode:04o};"
            f" do `chmod 600 {path}`"
        )
    return ""


def is_writable_by_all(folder: Path) -> bool:
    """Return whether every user of the machine may create files in a folder; False if unknown."""
    try:  # Windows has no such mode; there, a user's folders are closed to others by default
        return sys.platform != "win32" and bool(os.stat(folder).st_mode & stat.S_IWOTH)
    except OSError:
        return False


def is_written_by_us_only(descriptor: int) -> bool:
    """Return whether only this user or root can write a file; others may be able to read it.

    Always true on Windows, where file modes do not mention other users.
    """
    found = os.fstat(descriptor)
    return sys.platform == "win32" or (is_ours_or_roots(found) and not found.st_mode & 0o022)


def write_private(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Write a file that only this user can read; a reader sees the old or the new file, complete.

    Without `sync` it does not wait for the disk, so a failure of the machine may lose the file.
    """
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    with _folder_of(path) as folder:

        def place(path: Path) -> str:
            return str(path) if folder is None else path.name

        # The user that made it may be able to read it.
        with contextlib.suppress(FileNotFoundError):
            os.unlink(place(new), dir_fd=folder)
        descriptor = open_private(place(new), must_be_new=True, dir_fd=folder)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                if sync:
                    os.fsync(file.fileno())
            os.replace(place(new), place(path), src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(place(new), dir_fd=folder)
            raise


@contextlib.contextmanager
def _folder_of(path: Path) -> Iterator[int | None]:
    """Open the folder of a file: all steps then take place in it, also if it is moved meanwhile.

    Yields None on Windows.
    """
    if sys.platform == "win32":
        yield None
    else:
        descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            yield descriptor
        finally:
            os.close(descriptor)


def set_mode(path: Path | str, mode: int, *, dir_fd: int | None = None) -> None:
    """Set the mode of a file or folder that is no link. Raises OSError."""
    if sys.platform == "linux":
        # The file itself is not opened: closing it would drop this process's locks of it.
        descriptor = os.open(path, os.O_PATH | os.O_NOFOLLOW, dir_fd=dir_fd)
        try:
            if stat.S_ISLNK(os.fstat(descriptor).st_mode):
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
            os.chmod(f"/proc/self/fd/{descriptor}", mode)
        finally:
            os.close(descriptor)
    elif sys.platform == "win32":
        os.chmod(path, mode)
    else:
        os.chmod(path, mode, dir_fd=dir_fd, follow_symlinks=False)


def read_text(path: str | os.PathLike[str], encoding: str = "utf-8") -> str:
    """Return the text of a user's file of at most 16 MiB, with `\\n` as line breaks.

    The file may be a pipe, such as a shell's `<(command)`. Raises OSError, and UnicodeDecodeError.
    """
    import io

    with open(path, "rb") as file:
        data = file.read(_LONGEST_TEXT + 1)
    if len(data) > _LONGEST_TEXT:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), os.fspath(path))
    return io.TextIOWrapper(io.BytesIO(data), encoding).read()


def write_at(descriptor: int, data: bytes, place: int) -> None:
    """Write into the middle of an open file; the file's position afterwards is undefined."""
    if sys.platform == "win32":
        os.lseek(descriptor, place, os.SEEK_SET)
        os.write(descriptor, data)
    else:
        os.pwrite(descriptor, data, place)


def is_same_file(path: Path, known: os.stat_result) -> bool:
    """Return whether a path still leads to a known file, which must be open."""
    try:  # on Windows an open file cannot be removed or replaced
        return sys.platform == "win32" or os.path.samestat(os.stat(path), known)
    except OSError:
        return False


def lock(descriptor: int) -> None:
    """Wait for the file's lock and take it; the system releases it when the process ends."""
    _lock(descriptor, wait=True)


def try_lock(descriptor: int) -> bool:
    """Take the file's lock if it is free; returns whether it was.

    The system releases it when the process ends. Raises OSError if the file system has no locks.
    """
    try:
        _lock(descriptor, wait=False)
    except OSError as error:
        if error.errno not in _HELD:
            raise
        return False
    return True


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait for the lock of a lock file, and hold it while the block runs."""
    descriptor = open_private(path)
    try:
        _lock(descriptor, wait=True)
        yield
    finally:
        os.close(descriptor)


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int, *, wait: bool, offset: int = _LOCK_OFFSET) -> None:
        # Do not use LK_LOCK: it sleeps a whole second between two attempts.
        import time

        give_up = time.monotonic() + _LONGEST_HOLD if wait else 0.0
        while True:
            try:
                return _locking(descriptor, msvcrt.LK_NBLCK, offset)
            except OSError as error:
                if error.errno not in _HELD or time.monotonic() >= give_up:
                    raise
            time.sleep(_LOCK_RETRY)

    def _locking(descriptor: int, mode: int, offset: int = _LOCK_OFFSET) -> None:
        # Windows locks at the current position; the caller reads from the beginning afterwards.
        os.lseek(descriptor, offset, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, mode, 1)
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)

    def is_locked(descriptor: int) -> bool:
        """Whether a process holds the file's lock."""
        # One after the other: two programs that check at once would name each other as holder.
        _lock(descriptor, wait=True, offset=_LOCK_OFFSET + 1)
        try:
            if not try_lock(descriptor):
                return True
            _locking(descriptor, msvcrt.LK_UNLCK)
            return False
        finally:
            _locking(descriptor, msvcrt.LK_UNLCK, _LOCK_OFFSET + 1)

else:
    import fcntl

    def _lock(descriptor: int, *, wait: bool) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))

    def is_locked(descriptor: int) -> bool:
        """Whether a process holds the file's lock."""
        try:
            # Shared, so that two programs that check at once do not name each other as holder.
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
        fcntl.flock(descriptor, fcntl.LOCK_UN)
        return False


@cache
def keep_freed_memory(size: int) -> None:
    """Let Linux's allocator keep the freed memory of messages of up to `size` bytes.

    Normally the allocator returns the top of its heap to the system when more than 128 KiB are
    free, and requests it again a moment later; for a message of 1 MiB, that takes most of the time.
    After it has once freed a block of this size, it keeps twice as much. The block costs nothing,
    because nothing is written to it. Source: M_MMAP_THRESHOLD in mallopt(3). Other systems'
    allocators need no such hint.
    """
    if sys.platform == "linux":
        bytes(size)


def descriptor_limit() -> int:
    """Return how many files and sockets this process may have open at a time."""
    if sys.platform == "win32" or sys.platform == "emscripten":
        return _NO_LIMIT
    else:
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return _NO_LIMIT if soft == resource.RLIM_INFINITY else soft


@contextlib.contextmanager
def stop_signals(stop: Callable[[int], object]) -> Iterator[None]:
    """Call `stop(signal number)` at Ctrl-C, SIGTERM and Windows' Ctrl-Break.

    `stop` runs on the main thread, between any two of its steps. Only the main thread can change
    signal handlers: in other threads, this does nothing. Blocks may overlap; the `stop` of each is
    called.
    """
    import signal
    import threading

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if not _stops:
        _before.update({number: signal.signal(number, _stop_all) for number in _stop_signals()})
    _stops.append(stop)
    try:
        yield
    finally:
        _stops.remove(stop)
        if not _stops:
            for number, handler in _before.items():
                signal.signal(number, handler)


_stops: list[Callable[[int], object]] = []
"""The functions of all open `stop_signals` blocks."""
_before: dict[int, Any] = {}
"""The program's own signal handlers, to restore after the last block."""


def _stop_all(number: int, _: object) -> None:
    for stop in tuple(_stops):
        stop(number)


def _stop_signals() -> list[int]:
    import signal

    names = ("SIGINT", "SIGTERM", "SIGBREAK")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def reason_of(error: OSError) -> str:
    """Return the system's text for an error; frequent errors have the same text everywhere."""
    if sys.platform == "win32":
        if error.winerror == _REFUSED or error.errno == errno.ECONNREFUSED:
            return "Connection refused"
        if error.errno == errno.EADDRINUSE:
            return "Address already in use"
        if error.errno == errno.ENOENT:
            return "No such file or directory"
        return error.strerror or str(error)
    else:  # asyncio puts its own sentences into `strerror`
        return os.strerror(error.errno) if error.errno else str(error)


def prepare_output() -> None:
    """Let stdout and stderr accept any character, even if the terminal cannot show it."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def end_process(pid: int, *, at_once: bool = False) -> None:
    """Send a process the signal to end; with `at_once`, kill it.

    Raises ProcessLookupError if there is no such process.
    """
    import signal

    if sys.platform == "win32":
        # On Windows, SIGTERM is TerminateProcess. Only Ctrl-Break would let the process end
        # gracefully, and it can only be sent to groups.
        try:
            os.kill(pid, signal.SIGTERM)
        except OSError as error:
            if error.winerror == _NO_SUCH_PROCESS:
                raise ProcessLookupError(errno.ESRCH, os.strerror(errno.ESRCH)) from None
            raise
    else:
        os.kill(pid, signal.SIGKILL if at_once else signal.SIGTERM)
        # A process stopped by Ctrl-Z handles signals only after it continues.
        os.kill(pid, signal.SIGCONT)


def has_open(pid: int, file: os.stat_result) -> bool:
    """Return whether a process has a file open; where the system does not tell, True for any pid.

    Linux tells it for this user's processes. Ids below 1 mean groups of processes: always False.
    """
    if pid < 1 or not os.path.isdir("/proc/self/fd"):
        return pid > 0
    folder = f"/proc/{pid}/fd"
    with contextlib.suppress(OSError):  # it has ended, or belongs to another user
        for descriptor in os.listdir(folder):
            with contextlib.suppress(OSError):  # it may have just been closed
                if os.path.samestat(os.stat(f"{folder}/{descriptor}"), file):
                    return True
    return False


def ignores_end(pid: int) -> bool:
    """Return whether a process ignores the signal to end; only Linux tells it."""
    import signal

    with contextlib.suppress(OSError, ValueError), open(f"/proc/{pid}/status", "rb") as file:
        for line in file:
            if line.startswith(b"SigIgn:"):
                return bool(int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
    return False


def is_stopped(pid: int) -> bool:
    """Return whether a process is stopped, for example by Ctrl-Z, until it gets SIGCONT."""
    return _state_of(pid) in (b"T", b"t")


def has_ended(pid: int) -> bool:
    """Return whether no program runs as this process any more. Windows does not tell: always True.

    A process that has ended keeps its id until its parent has read its exit status.
    """
    return _state_of(pid) in (b"", b"Z", b"X")


def _state_of(pid: int) -> bytes:
    """Return the letter of a process's state as in ps(1), b"" if there is no such process."""
    status = f"/proc/{pid}/stat"
    with contextlib.suppress(OSError):  # it may have just ended
        if os.path.exists(status):
            with open(status, "rb") as file:
                return file.read().rpartition(b")")[2].split()[0]
        if sys.platform != "win32":
            import subprocess

            command = ["ps", "-o", "stat=", "-p", str(pid)]
            return subprocess.run(command, capture_output=True, check=False).stdout.strip()[:1]
    return b""


@contextlib.contextmanager
def keys_pressed(pressed: Callable[[str], object]) -> Iterator[None]:
    """Call `pressed` on the running event loop for each key, while the block runs.

    Keys are not shown. Without a terminal on stdin, and in the background, the block just runs.
    Ctrl-C stays a signal. The terminal is restored at the end.
    """
    try:
        descriptor = sys.stdin.fileno() if sys.stdin.isatty() else -1
    except (AttributeError, OSError, ValueError):  # stdin is closed
        descriptor = -1
    if descriptor < 0:
        yield
        return
    with _keys_read(descriptor, pressed):
        yield


if sys.platform == "win32":

    @contextlib.contextmanager
    def _keys_read(descriptor: int, pressed: Callable[[str], object]) -> Iterator[None]:
        import asyncio
        import msvcrt

        async def read() -> None:
            is_code = False
            while True:  # the console has no event that asyncio can wait for
                while msvcrt.kbhit():
                    key = msvcrt.getwch()
                    # A key without a character, such as Page Down, arrives as a prefix and a code,
                    # which may be the letter of another key. kbhit() may show the code only when
                    # the next key is pressed, so it is not read at once: that could block.
                    if is_code or key in _PREFIXES:
                        is_code = not is_code
                    else:
                        pressed(key)
                await asyncio.sleep(_KEY_POLL)

        reading = asyncio.get_running_loop().create_task(read())
        try:
            yield
        finally:
            reading.cancel()

else:

    @contextlib.contextmanager
    def _keys_read(descriptor: int, pressed: Callable[[str], object]) -> Iterator[None]:
        import asyncio
        import termios
        import tty

        if os.tcgetpgrp(descriptor) != os.getpgrp():  # changing the terminal would stop us
            yield
            return
        loop = asyncio.get_running_loop()

        def read() -> None:
            typed = os.read(descriptor, 64)
            if not typed:  # the terminal is gone
                loop.remove_reader(descriptor)
            for key in typed.decode(errors="ignore"):
                pressed(key)

        before = termios.tcgetattr(descriptor)
        try:
            tty.setcbreak(descriptor, termios.TCSANOW)
            loop.add_reader(descriptor, read)
            yield
        finally:
            loop.remove_reader(descriptor)
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
