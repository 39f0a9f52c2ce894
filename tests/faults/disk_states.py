"""Possible disk contents after a machine failure: all synced data, and any part of the rest.

`recorded` runs a program under strace and returns its operations on the files of a folder. A `Disk`
follows these, and at any point generates disks that a machine failure could leave behind:
unsynced pages are there or not, each as it was at any time since the sync, or torn.
"""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

PAGE, SECTOR = 4096, 512
_CALLS = "openat,write,pwrite64,ftruncate,unlink,fsync,fdatasync"
_LINE = re.compile(r"(\d+) +(.*)")
_RESUMED = re.compile(r"<\.\.\. \w+ resumed>(.*)")
_CALL = re.compile(r"(\w+)\((.*)\) += (-?\d+)")
_FILE = re.compile(r"\d+<([^>]*)>")
_TEXT = re.compile(r'"((?:[^"\\]|\\.)*)"')


def recorded(command, folder, *, inject=()):
    """Run a program and yield (kind, name, detail) for each of its operations in a folder.

    The kinds: "write" (offset, data), "truncate" size, "sync" whether it worked, "unlink", "open".
    The folder itself has the name "".
    """
    log = Path(folder).with_suffix(".strace")
    strace = ["strace", "-f", "-y", "-s", "1000000", "-e", f"trace={_CALLS}", "-o", str(log)]
    faults = [word for each in inject for word in ("-e", f"inject={each}")]
    ran = subprocess.run([*strace, *faults, *command], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    lines = log.read_text(encoding="latin-1").splitlines()
    log.unlink()
    return list(_events(lines, str(folder)))


def _events(lines, folder):
    begun, ends = {}, {}  # by thread; by name, the position for appends
    for line in lines:
        thread, text = _LINE.fullmatch(line).groups()
        if text.endswith("<unfinished ...>"):
            begun[thread] = text.removesuffix("<unfinished ...>")
            continue
        if resumed := _RESUMED.match(text):
            text = begun.pop(thread) + resumed[1]
        if called := _CALL.match(text):
            yield from _event(called[1], called[2], int(called[3]), folder, ends)


def _event(call, arguments, result, folder, ends):
    path = _TEXT.search(arguments) if call in {"openat", "unlink"} else _FILE.match(arguments)
    if path is None or not f"{path[1]}/".startswith(f"{folder}/"):
        return
    name = path[1].removeprefix(folder).removeprefix("/")
    if call in {"fsync", "fdatasync"}:
        yield "sync", name, result == 0
    elif result < 0:
        return
    elif call == "ftruncate":
        yield "truncate", name, int(arguments.rpartition(",")[2])
    elif call in {"openat", "unlink"}:
        yield call.removesuffix("at"), name, None
    else:
        data = ast.literal_eval(f'b"{_TEXT.search(arguments)[1]}"')[:result]
        at = int(arguments.rpartition(",")[2]) if call == "pwrite64" else ends.get(name, 0)
        ends[name] = at + len(data)
        yield "write", name, (at, data)


class File:
    """One file: as programs see it, its certain contents on the disk, and its possible ones."""

    def __init__(self):
        self.seen = bytearray()
        self._synced: dict[int, bytes] = {}
        self._synced_size = 0
        self._since: dict[int, list[bytes]] = {}  # page -> its contents since the last sync
        self._sizes: list[int] = []
        self._dirty: set[int] = set()

    def write(self, offset, data):
        end = offset + len(data)
        if end > len(self.seen):
            self._resize(end)
        self.seen[offset:end] = data
        for page in range(offset // PAGE, -(-end // PAGE)):
            self._changed(page)

    def truncate(self, size):
        self._resize(size)
        self._changed(size // PAGE)

    def synced(self, worked):
        """After a failed sync the system treats unwritten pages as written."""
        if worked:
            for page in self._dirty:
                self._synced[page] = self._page(page)
                del self._since[page]
            self._synced_size, self._sizes = len(self.seen), []
        self._dirty.clear()

    def left(self, chance):
        """Contents that a machine failure may leave; without `chance`, only the certain ones."""
        size, pages = self._synced_size, dict(self._synced)
        if chance is not None:
            size = chance.choice([size, *self._sizes])
            for page, versions in self._since.items():
                pages[page] = _torn([pages.get(page, bytes(PAGE)), *versions], chance)
        content = bytearray(size)
        for page, data in pages.items():
            if page * PAGE < size:
                content[page * PAGE : (page + 1) * PAGE] = data
        return bytes(content[:size])

    def _resize(self, size):
        self.seen[size:] = bytes(max(0, size - len(self.seen)))
        self._sizes.append(size)

    def _changed(self, page):
        self._since.setdefault(page, []).append(self._page(page))
        self._dirty.add(page)

    def _page(self, page):
        return bytes(self.seen[page * PAGE : (page + 1) * PAGE]).ljust(PAGE, b"\0")


def _torn(versions, chance):
    last = chance.randrange(len(versions))
    if last == 0 or chance.random() < 0.7:
        return versions[last]
    sectors = range(0, PAGE, SECTOR)
    return b"".join(versions[last - chance.randrange(2)][at : at + SECTOR] for at in sectors)


class Disk:
    """The files of a folder; names that end in `ignored` are left out."""

    def __init__(self, ignored=()):
        self._ignored = tuple(ignored)
        self._names: dict[str, File] = {}
        self._synced_names: dict[str, File] = {}
        self._names_since: list[dict[str, File]] = []

    def follow(self, kind, name, detail):
        """Apply a program's operation."""
        if name.endswith(self._ignored):
            return
        if not name:
            if kind == "sync" and detail:
                self._synced_names, self._names_since = self._names, []
        elif kind == "open":
            if name not in self._names:
                self._rename({**self._names, name: File()})
        elif kind == "unlink":
            self._rename({other: file for other, file in self._names.items() if other != name})
        elif kind == "write":
            self._names[name].write(*detail)
        elif kind == "truncate":
            self._names[name].truncate(detail)
        else:
            self._names[name].synced(detail)

    def left(self, chance=None):
        """Possible contents by file name after a failure; without `chance`, the certain ones."""
        names = self._synced_names
        if chance is not None:
            names = chance.choice([names, *self._names_since])
        return {name: file.left(chance) for name, file in names.items()}

    def seen(self):
        """The contents after the program alone has died."""
        return {name: bytes(file.seen) for name, file in self._names.items()}

    def _rename(self, names):
        self._names = names
        self._names_since.append(names)
