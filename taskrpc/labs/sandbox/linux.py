"""What Linux itself forbids to a process, for ever: seccomp for system calls, Landlock for files.

Both need no rights. A process that has confined itself cannot undo it, whatever it does. Older
kernels and some containers lack Landlock (Linux 5.13); then only the audit hook of `guard` watches
over files.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

_libc = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None

_PR_SET_PDEATHSIG, _PR_SET_SECCOMP, _PR_SET_CHILD_SUBREAPER, _PR_SET_NO_NEW_PRIVS = 1, 22, 36, 38
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_READ = 1 | 4 | 8  # execute and read files, list folders
_FILE = 1 | 2 | 4 | 1 << 14 | 1 << 15  # the rights that concern files alone
_DEVICES = 1 << 6 | 1 << 10 | 1 << 11  # make devices and named pipes
_HANDLED = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}
"""The rights of files that each version of Landlock knows."""

_ALLOW, _KILL, _EPERM, _ENOSYS = 0x7FFF0000, 0x80000000, 0x00050001, 0x00050026
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # BPF
_AND = 0x54
_SHARED_WITHOUT_FILE = 0x21  # MAP_SHARED and MAP_ANONYMOUS
_CLONE_THREAD = 0x10000
_AF_UNIX = 1
_SIGKILL = 9

# The numbers of system calls, for x86-64 and for AArch64; -1: there is none.
_SYSTEMS = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
_FORBIDDEN = {
    "fork": (57, -1),
    "vfork": (58, -1),
    "execve": (59, 221),
    "execveat": (322, 281),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "pidfd_send_signal": (424, 424),
    "pidfd_open": (434, 434),
    "pidfd_getfd": (438, 438),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "io_uring_setup": (425, 425),
    "setrlimit": (160, 164),
    "setsid": (112, 157),
    "setpgid": (109, 154),
    "unshare": (272, 97),
    "setns": (308, 268),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "mount_setattr": (442, 442),
    "open_by_handle_at": (304, 265),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "kexec_load": (246, 104),
    "reboot": (169, 142),
    "swapon": (167, 224),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "sethostname": (170, 161),
    "shmget": (29, 194),
    "msgget": (68, 186),
    "semget": (64, 190),
    # The memory of these files is no data of the process, so no limit counts it.
    "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
    # Root could make a disk a file of its folder, or take the processors from the checks.
    "mknod": (133, -1),
    "mknodat": (259, 33),
    "setpriority": (141, 140),
    "sched_setscheduler": (144, 119),
    "sched_setparam": (142, 118),
    "sched_setattr": (314, 274),
}
_CLONE, _CLONE3 = (56, 220), (435, 435)
_KILL_CALLS = ((62, 129), (200, 130), (234, 131))  # kill, tkill, tgkill
_SOCKET = (41, 198)
_MMAP = (9, 222)
_PRLIMIT = (302, 261)
_PRCTL = (157, 167)


def die_with_parent() -> None:
    """Let this process be killed when the thread that started it ends; only on Linux."""
    _prctl(_PR_SET_PDEATHSIG, _SIGKILL)


def adopt_orphans() -> None:
    """Become the parent of descendants whose own parent has ended; only on Linux."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def adopted() -> list[int]:
    """Return the ids of this process's children, also of adopted ones; [] if unknown."""
    pids: list[int] = []
    for tasks in Path("/proc/self/task").glob("*/children") if _libc else ():
        try:
            pids += map(int, tasks.read_text().split())
        except (OSError, ValueError):
            continue
    return pids


def can_confine() -> bool:
    """Return whether this system has filters for system calls that this module knows."""
    return _libc is not None and platform.machine() in _SYSTEMS and sys.byteorder == "little"


def forbid_system_calls() -> bool:
    """Forbid new processes, sockets other than Unix's, signals to others, and administration.

    Also memory without a limit, and files that are devices or named pipes.

    Returns whether the system accepted that. Threads that run already are not concerned.
    """
    if not can_confine():
        return False
    column, architecture = _SYSTEMS[platform.machine()]
    code = _program(column, architecture, os.getpid())
    instructions = ctypes.create_string_buffer(code)
    program = struct.pack("HxxxxxxQ", len(code) // 8, ctypes.addressof(instructions))
    _prctl(_PR_SET_NO_NEW_PRIVS, 1)
    return _prctl(_PR_SET_SECCOMP, 2, program)


def limit_files(readable: Iterable[Path], writable: Iterable[Path]) -> bool:
    """Let this process read only some files and folders, and write only in others.

    Returns whether the system can do that. Files that do not exist are left out.
    """
    if _libc is None:
        return False
    version = _libc.syscall(_CREATE_RULESET, None, 0, 1)
    if version < 1:
        return False
    handled = _HANDLED[max(each for each in _HANDLED if each <= version)]
    # Files; no TCP; signals and abstract sockets only among the confined.
    settings = struct.pack("QQQ", handled, 3, 3)[
        : 24 if version >= 6 else 16 if version >= 4 else 8
    ]
    rules = _libc.syscall(_CREATE_RULESET, settings, len(settings), 0)
    if rules < 0:
        return False
    try:
        for path in readable:
            _allow(rules, path, _READ)
        for path in writable:
            _allow(rules, path, handled & ~_DEVICES)
        _prctl(_PR_SET_NO_NEW_PRIVS, 1)
        return bool(_libc.syscall(_RESTRICT_SELF, rules, 0) == 0)
    finally:
        os.close(rules)


def _allow(rules: int, path: Path, rights: int) -> None:
    assert _libc is not None
    try:
        place = os.open(path, getattr(os, "O_PATH", 0) | getattr(os, "O_CLOEXEC", 0))
    except OSError:
        return
    try:
        if not path.is_dir():
            rights &= _FILE
        _libc.syscall(_ADD_RULE, rules, 1, struct.pack("=Qi", rights, place), 0)
    finally:
        os.close(place)


def _prctl(option: int, *values: int | bytes) -> bool:
    if _libc is None:
        return False
    padded = [*values, 0, 0, 0, 0][:4]
    words = [ctypes.c_ulong(each) if isinstance(each, int) else each for each in padded]
    return bool(_libc.prctl(option, *words) == 0)


def _program(column: int, architecture: int, pid: int) -> bytes:
    """The filter, as instructions of BPF."""
    code: list[tuple[int, int, int, int]] = []

    def when(test: int, value: int, action: int) -> None:
        code.extend([(test, 0, 1, value), (_RETURN, 0, 0, action)])

    def about(call: int, checks: list[tuple[int, int, int, int]]) -> None:
        """For this system call run the checks, which end with a return."""
        code.extend([(_EQUAL, 0, len(checks), call), *checks])

    def checked(number: int, test: int, value: int) -> list[tuple[int, int, int, int]]:
        load = (_LOAD, 0, 0, 16 + 8 * number)
        return [load, (test, 0, 1, value), (_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _EPERM)]

    code.extend([(_LOAD, 0, 0, 4), (_EQUAL, 1, 0, architecture), (_RETURN, 0, 0, _KILL)])
    code.append((_LOAD, 0, 0, 0))
    when(_AT_LEAST, 0x40000000, _EPERM)  # x86-64's other numbers for the same calls
    for numbers in _FORBIDDEN.values():
        if numbers[column] >= 0:
            when(_EQUAL, numbers[column], _EPERM)
    when(_EQUAL, _CLONE3[column], _ENOSYS)  # the C library then uses clone
    about(_CLONE[column], checked(0, _ANY_BIT, _CLONE_THREAD))
    for numbers in _KILL_CALLS:
        about(numbers[column], checked(0, _EQUAL, pid))
    about(_SOCKET[column], checked(0, _EQUAL, _AF_UNIX))
    flags = [(_LOAD, 0, 0, 16 + 8 * 3), (_AND, 0, 0, _SHARED_WITHOUT_FILE)]
    shared = [(_EQUAL, 0, 1, _SHARED_WITHOUT_FILE), (_RETURN, 0, 0, _EPERM)]
    about(_MMAP[column], [*flags, *shared, (_RETURN, 0, 0, _ALLOW)])
    no_new_limit = [(_LOAD, 0, 0, 16 + 16 + 4), (_EQUAL, 1, 0, 0), (_RETURN, 0, 0, _EPERM)]
    about(_PRLIMIT[column], [*no_new_limit, *checked(2, _EQUAL, 0)])
    death = [(_LOAD, 0, 0, 16), (_EQUAL, 0, 1, _PR_SET_PDEATHSIG), (_RETURN, 0, 0, _EPERM)]
    about(_PRCTL[column], [*death, (_RETURN, 0, 0, _ALLOW)])
    code.append((_RETURN, 0, 0, _ALLOW))
    return b"".join(struct.pack("=HBBI", *each) for each in code)
