"""The filter for system calls that bubblewrap loads: what no namespace and no limit covers. Pure.

The kernel then refuses new user namespaces, in which a program could mount folders without a limit,
memory that is no data of a process, and the keys of the user. A filter is a program of BPF; see
seccomp(2) of Linux.
"""

from __future__ import annotations

import struct

_ALLOW, _KILL, _EPERM, _ENOSYS = 0x7FFF0000, 0x80000000, 0x00050001, 0x00050026
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ARCHITECTURE, _NUMBER, _FIRST_ARGUMENT = 4, 0, 16
"""Where the kernel puts these for the filter."""
_CLONE_NEWUSER = 0x10000000
_OTHER_X86 = 0x40000000
"""x86-64 has other numbers for the same calls, from here."""

_SYSTEMS = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
_FORBIDDEN = {
    "unshare": (272, 97),
    "setns": (308, 268),
    "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
    "shmget": (29, 194),
    "semget": (64, 190),
    "msgget": (68, 186),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "pidfd_getfd": (438, 438),
    "io_uring_setup": (425, 425),
    "userfaultfd": (323, 282),
    "perf_event_open": (298, 241),
    "bpf": (321, 280),
}
"""The numbers of system calls, for x86-64 and for AArch64."""
_CLONE, _CLONE3 = (56, 220), (435, 435)


def filter_for(machine: str) -> bytes:
    """Return the filter for a processor as `platform.machine` names it; b"" for an unknown one."""
    if machine not in _SYSTEMS:
        return b""
    column, architecture = _SYSTEMS[machine]
    code: list[tuple[int, int, int, int]] = []

    def when(test: int, value: int, action: int) -> None:
        code.extend([(test, 0, 1, value), (_RETURN, 0, 0, action)])

    code.extend([(_LOAD, 0, 0, _ARCHITECTURE), (_EQUAL, 1, 0, architecture)])
    code.extend([(_RETURN, 0, 0, _KILL), (_LOAD, 0, 0, _NUMBER)])
    when(_AT_LEAST, _OTHER_X86, _EPERM)
    for numbers in _FORBIDDEN.values():
        when(_EQUAL, numbers[column], _EPERM)
    when(_EQUAL, _CLONE3[column], _ENOSYS)  # the C library then uses clone
    code.extend([(_EQUAL, 0, 3, _CLONE[column]), (_LOAD, 0, 0, _FIRST_ARGUMENT)])
    when(_ANY_BIT, _CLONE_NEWUSER, _EPERM)
    code.append((_RETURN, 0, 0, _ALLOW))
    return b"".join(struct.pack("=HBBI", *each) for each in code)
