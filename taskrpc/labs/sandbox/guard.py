"""An audit hook that refuses what a program of a lab has no reason to do, and says so.

It works on every system, and its errors name the reason. Python code that attacks Python itself
could get round it; where `linux` works, the kernel stops that as well.
"""

from __future__ import annotations

import ipaddress
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

_PROCESSES = (
    "subprocess.Popen",
    "os.exec",
    "os.fork",
    "os.forkpty",
    "os.posix_spawn",
    "os.spawn",
    "os.startfile",
    "os.startfile/2",
    "os.system",
    "pty.spawn",
    "webbrowser.open",
    "_winapi.CreateProcess",
)
_OTHERS = ("_winapi.OpenProcess", "_winapi.TerminateProcess", "os.kill", "os.killpg")
_IMPORTS = ("ctypes", "_ctypes", "_posixsubprocess")
_WRITES = {
    "os.chmod": 1,
    "os.chown": 1,
    "os.link": 2,
    "os.mkdir": 1,
    "os.remove": 1,
    "os.removexattr": 1,
    "os.rename": 2,
    "os.rmdir": 1,
    "os.setxattr": 1,
    "os.truncate": 1,
    "os.utime": 1,
}
"""Events of changes to files, and how many of their arguments are paths."""
_READS = ("os.listdir", "os.scandir", "sqlite3.connect", "glob.glob")
_PLACES = ("socket.bind", "socket.connect", "socket.sendto", "socket.sendmsg")
_NAMES = ("socket.getaddrinfo", "socket.gethostbyname")
_CHANGES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

# Python reads these while it runs; a program may discard its output.
_SYSTEM = (
    "/usr",
    "/lib",
    "/lib64",
    "/dev/null",
    "/dev/urandom",
    "/dev/random",
    "/dev/zero",
)
_SETTINGS = ("/etc/localtime", "/etc/ld.so.cache", "/etc/mime.types", "/sys/devices/system/cpu")


def readable() -> list[Path]:
    """Return what a program of a lab may read besides its folder: Python and its packages."""
    # The packages themselves, not the folder that contains them: solutions lie beside them.
    ours = [Path(sys.modules[name].__file__ or "").parent for name in ("taskrpc", "srvgen")]
    python = [Path(each) for each in (sys.prefix, sys.base_prefix, sys.exec_prefix)]
    packages = [Path(each) for each in sys.path if each.endswith(("-packages", ".zip"))]
    roots = [*ours, *python, *packages, *map(Path, _SYSTEM), *map(Path, _SETTINGS)]
    if sys.platform == "win32":
        roots.append(Path(os.environ.get("SYSTEMROOT", "C:\\Windows")))
    elif sys.platform == "darwin":
        roots += [Path("/System"), Path("/Library"), Path("/private/var/db/timezone")]
    else:
        roots.append(Path("/proc/self").resolve())
    return [each for each in roots if each != Path(each.anchor)]


def install(readable: Iterable[Path], writable: Iterable[Path]) -> None:
    """Refuse everything else from now on; this cannot be undone.

    Raises PermissionError in the code that tries it, or ImportError for ctypes.
    """
    write = _below(writable, allowed=(os.devnull,))
    read = _below([*readable, *writable])
    own = os.getpid()

    def check(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open":
            path, mode, flags = arguments
            changes = flags & _CHANGES if isinstance(flags, int) else False
            if isinstance(mode, str):
                changes = bool(set(mode) & set("wax+"))
            _check_path(path, write if changes else read, "write" if changes else "read")
        elif event in _WRITES:
            for path in arguments[: _WRITES[event]]:
                _check_path(path, write, "change")
        elif event == "os.symlink":
            _check_path(arguments[1], write, "change")
        elif event in _READS:
            if arguments[0] != ":memory:":
                _check_path(arguments[0], read, "read")
        elif event in _PLACES:
            _check_place(arguments[1], write)
        elif event in _NAMES:
            _check_host(arguments[0])
        elif event != "os.kill" or arguments[0] != own:
            _check_event(event, arguments)

    sys.addaudithook(check)


def _check_event(event: str, arguments: tuple[object, ...]) -> None:
    """Refuse what no program of a lab needs, with any arguments."""
    if event in _PROCESSES:
        raise PermissionError("a program under check may not start other programs")
    if event in _OTHERS:
        raise PermissionError("a program under check may not end other programs")
    if event == "resource.setrlimit":
        raise PermissionError("a program under check may not change its limits")
    if event.startswith("ctypes.") or (event == "import" and arguments[0] in _IMPORTS):
        raise ImportError(f"a program under check may not use {arguments[0] or 'ctypes'}")


def _below(folders: Iterable[Path], allowed: tuple[str, ...] = ()) -> Callable[[str], bool]:
    """A test whether a path, links followed, is below one of the folders."""
    roots = tuple({os.path.normcase(os.path.realpath(each)) for each in folders})
    starts = tuple(root.rstrip(os.sep) + os.sep for root in roots)
    real, normal = os.path.realpath, os.path.normcase

    def test(path: str) -> bool:
        found = normal(real(path))
        return found in roots or found.startswith(starts) or path in allowed

    return test


def _check_path(path: object, test: Callable[[str], bool], verb: str) -> None:
    if isinstance(path, os.PathLike):
        path = os.fspath(path)
    if isinstance(path, bytes):
        path = os.fsdecode(path)
    if path is None:
        path = "."
    if isinstance(path, str) and not test(path):
        raise PermissionError(f"a program under check may not {verb} {path}: not in its folder")


def _check_place(place: object, test: Callable[[str], bool]) -> None:
    if isinstance(place, tuple):
        _check_host(place[0])
    elif isinstance(place, bytes) and place[:1] == b"\0":
        raise PermissionError("a program under check may not use abstract sockets")
    else:
        _check_path(place, test, "use")


def _check_host(host: object) -> None:
    if isinstance(host, bytes):
        host = os.fsdecode(host)
    if host and not _is_loopback(str(host)):
        raise PermissionError(f"a program under check has no network: it may not reach {host}")


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
