"""The command line of a sandbox: bubblewrap, with namespaces of its own and few files to see.

Inside are Python with its packages and the submission, all read-only, and `/tmp`, which is empty
and of limited size. There is no network except the sandbox's own loopback.

A grader that runs as root starts the sandbox as a user whose id nobody else has. A limit of
processes does not hold for root, and files of root must not become writable by a mistake. A first
bubblewrap makes the files reachable for this user, because folders such as /root are closed.
"""

from __future__ import annotations

import os
import platform
import secrets
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import srvgen
import taskrpc
from taskrpc.course.labs.sandbox.limits import FOLDER
from taskrpc.course.labs.sandbox.system_calls import filter_for

SUBMISSION = "/submission"
"""The folder of the submission in the sandbox."""
WRITABLE = "/tmp"
"""The only folder in which its programs can make files."""
_NAMESPACES = ("user", "pid", "net", "ipc", "uts", "cgroup")
_SYSTEM = ("/usr", "/lib", "/lib32", "/lib64", "/libx32", "/bin", "/sbin")
_SETTINGS = ("/etc/ld.so.cache", "/etc/localtime", "/etc/alternatives")
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")
_OPEN = 0o005
"""The permissions that all users need to read and enter a folder."""
_FIRST_ID, _IDS = 2**30, 2**29
"""User ids that no distribution gives to users or containers by itself."""
_TRIAL = (
    "import os, threading; thread = threading.Thread(target=os.getpid); thread.start();"
    "thread.join(); open('/tmp/file', 'w').close(); import msgspec, srvgen, taskrpc"
)
_PATIENCE = 30.0
"""Seconds for the trial start."""


def why_not() -> str:
    """Return why this system has no sandbox, "" if a trial start succeeds."""
    if platform.system() != "Linux":
        return "bubblewrap is a program for Linux"
    if shutil.which("bwrap") is None:
        return "bubblewrap is not installed"
    paths = [each for each in sys.path if Path(each).is_absolute()]
    python = [sys.executable, "-I", "-c", f"import sys; sys.path[:] = {paths!r}; {_TRIAL}"]
    filter = filter_descriptor()
    try:
        command = confined(python, Path(__file__).parent, {}, filter)
        ended = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            pass_fds=(filter,),
            timeout=_PATIENCE,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"bubblewrap does not start: {error}"
    finally:
        os.close(filter)
    said = ended.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    return "" if ended.returncode == 0 else f"bubblewrap does not start here: {said}"


def filter_descriptor() -> int:
    """Return a descriptor from which bubblewrap reads the filter for system calls."""
    reading, writing = os.pipe()
    os.write(writing, filter_for(platform.machine()))
    os.close(writing)
    return reading


def confined(
    command: Sequence[str], submission: Path, environment: Mapping[str, str], filter: int
) -> list[str]:
    """Return the command line that runs a command in a sandbox.

    Args:
        command: inside, it is process 1 and starts in the folder of the submission.
        submission: the folder that is `SUBMISSION` inside.
        environment: all its variables.
        filter: a descriptor from `filter_descriptor`; the new process inherits it.
    """
    bwrap = shutil.which("bwrap") or "bwrap"
    files = list(_files(_python_folders()))
    shown = ["--ro-bind", str(submission), SUBMISSION]
    before: list[str] = []
    if sys.platform != "win32" and os.geteuid() == 0:
        id = str(_FIRST_ID + secrets.randbelow(_IDS))
        before = [bwrap, *files, *shown, "--bind", "/proc", "/proc", "--dev-bind", "/dev", "/dev"]
        before += ["--dir", "/tmp", "--cap-drop", "ALL", "--cap-add", "CAP_SETUID"]
        before += ["--cap-add", "CAP_SETGID", "--die-with-parent"]
        before += ["setpriv", "--reuid", id, "--regid", id, "--clear-groups"]
        before += ["--bounding-set", "-all", "--inh-caps", "-all"]
        shown[1] = SUBMISSION  # what the first one shows there
    words = [bwrap, *(f"--unshare-{each}" for each in _NAMESPACES), "--disable-userns"]
    words += ["--die-with-parent", "--new-session", "--as-pid-1", "--cap-drop", "ALL"]
    words += ["--hostname", "sandbox", "--clearenv"]
    for name, value in environment.items():
        words += ["--setenv", name, value]
    words += ["--size", str(FOLDER), "--tmpfs", WRITABLE, *files, *shown, "--proc", "/proc"]
    words += ["--perms", "0755", "--dir", "/dev"]
    for device in _DEVICES:
        words += ["--dev-bind", device, device]
    if filter_for(platform.machine()):
        words += ["--seccomp", str(filter)]
    return [*before, *words, "--remount-ro", "/", "--chdir", SUBMISSION, *command]


def _python_folders() -> list[Path]:
    """Return the folders of Python, of its packages, and of taskrpc."""
    # The packages themselves, not the folder that contains them: solutions lie beside them.
    ours = [Path(each.__file__ or "").parent for each in (taskrpc, srvgen)]
    python = [Path(each) for each in (sys.prefix, sys.base_prefix, sys.exec_prefix)]
    packages = [Path(each) for each in sys.path if each.endswith(("-packages", ".zip"))]
    found = [each for each in [*python, *packages, *ours] if each.exists()]
    # With a link on the way, Python may use either path.
    return [*found, *(each.resolve() for each in found)]


def _files(folders: Iterable[Path]) -> Iterator[str]:
    """Yield the arguments that show the system's files and these folders, read-only."""
    shown: list[Path] = []
    for name in _SYSTEM:
        if os.path.islink(name):
            yield from ("--symlink", os.readlink(name), name)
        elif os.path.isdir(name):
            yield from ("--ro-bind", name, name)
            shown.append(Path(name))
    settings = [Path(name) for name in _SETTINGS if os.path.exists(name)]
    made: set[Path] = set()
    # A folder comes before those in it, which it then shows too.
    for path in sorted({*folders, *settings}, key=lambda each: len(each.parts)):
        if path == Path("/") or any(path.is_relative_to(each) for each in shown):
            continue
        for above in reversed(path.parents[:-1]):
            if above not in made:
                made.add(above)
                yield from ("--perms", "0755", "--dir", str(above))
        if path.is_dir() and path.stat().st_mode & _OPEN != _OPEN:
            # The user of the sandbox may not enter this folder, for example a new environment
            # that `mktemp -d` has made. Its entries are shown in a folder that all may enter.
            yield from ("--perms", "0755", "--dir", str(path))
            made.add(path)
            for entry in sorted(path.iterdir()):
                yield from _entry(entry)
        else:
            yield from ("--ro-bind", str(path.resolve()), str(path))
        shown.append(path)


def _entry(path: Path) -> Iterator[str]:
    """Yield the arguments that show one file, folder or link, read-only."""
    if path.is_symlink():
        yield from ("--symlink", os.readlink(path), str(path))
    else:
        yield from ("--ro-bind", str(path), str(path))
