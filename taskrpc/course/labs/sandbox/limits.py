"""The limits of a program under check, and what each system enforces of them."""

from __future__ import annotations

import sys

import msgspec

MEGABYTE = 2**20


class Limits(msgspec.Struct, frozen=True):
    """What a program of a submission may use.

    Attributes:
        cpu: seconds of processor time.
        memory: bytes of its own data; not on macOS, whose system ignores the limit.
        file: bytes of one file that it writes; not on Windows.
        open_files: files and sockets that are open at the same time; not on Windows.
        output: bytes that it may write to both standard streams.
        processes: processes and threads of all programs in a sandbox; None without a sandbox,
            because the system would count all programs of the user.
    """

    cpu: int = 10
    memory: int = 1024 * MEGABYTE
    file: int = 10 * MEGABYTE
    open_files: int = 256
    output: int = 1 * MEGABYTE
    processes: int | None = None


LIMITS = Limits()
CONFINED = Limits(processes=256)
"""The limits of a program in a sandbox."""
RESIDENT = 1024 * MEGABYTE
"""Bytes of memory that all programs in a sandbox may hold together."""
FOLDER = 50 * MEGABYTE
"""Bytes of all files that the programs in a sandbox may make; the system refuses more."""
FILES = 2000
"""Number of files and folders that they may make."""


def limit_this_process(limits: Limits = LIMITS) -> None:
    """Let the system enforce what it can; a process cannot raise these limits again."""
    if sys.platform == "win32":
        _limit_job(limits)
    else:
        import resource

        values = {
            resource.RLIMIT_CPU: limits.cpu,
            resource.RLIMIT_DATA: limits.memory,
            resource.RLIMIT_FSIZE: limits.file,
            resource.RLIMIT_NOFILE: limits.open_files,
            resource.RLIMIT_CORE: 0,
        }
        if limits.processes is not None:
            values[resource.RLIMIT_NPROC] = limits.processes
        for limit, value in values.items():
            _, hard = resource.getrlimit(limit)
            most = value if hard == resource.RLIM_INFINITY else min(value, hard)
            # SIGXCPU, at the soft limit, tells the reason; SIGKILL follows at the hard limit.
            last = most + 1 if limit == resource.RLIMIT_CPU and most == value else most
            try:
                resource.setrlimit(limit, (most, last))
            except (ValueError, OSError):  # macOS refuses some limits that it does not enforce
                continue


if sys.platform == "win32":

    def _limit_job(limits: Limits) -> None:
        """Put this process into a job with limits for memory and processes, and no other end."""
        import ctypes

        class JobLimits(ctypes.Structure):
            _fields_ = (
                ("process_time", ctypes.c_int64),
                ("job_time", ctypes.c_int64),
                ("flags", ctypes.c_uint32),
                ("sizes", ctypes.c_size_t * 2),
                ("processes", ctypes.c_uint32),
                ("affinity", ctypes.c_size_t),
                ("classes", ctypes.c_uint32 * 2),
                ("counts", ctypes.c_uint64 * 6),
                ("process_memory", ctypes.c_size_t),
                ("job_memory", ctypes.c_size_t),
                ("peaks", ctypes.c_size_t * 2),
            )

        kernel = ctypes.windll.kernel32
        kernel.CreateJobObjectW.restype = ctypes.c_void_p
        kernel.GetCurrentProcess.restype = ctypes.c_void_p
        # PROCESS_TIME, ACTIVE_PROCESS, PROCESS_MEMORY, KILL_ON_JOB_CLOSE
        flags = 0x2 | 0x8 | 0x100 | 0x2000
        settings = JobLimits(
            process_time=limits.cpu * 10**7,
            flags=flags,
            processes=1,
            process_memory=limits.memory,
        )
        job = ctypes.c_void_p(kernel.CreateJobObjectW(None, None))
        # 9: JobObjectExtendedLimitInformation. The handle stays open until this process ends.
        kernel.SetInformationJobObject(job, 9, ctypes.byref(settings), ctypes.sizeof(settings))
        kernel.AssignProcessToJobObject(job, ctypes.c_void_p(kernel.GetCurrentProcess()))
