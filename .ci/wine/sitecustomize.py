"""Corrects what Wine 8 lacks of Windows, so that the tests see the product's faults and not Wine's.

Copied into the site-packages of the Windows Python that `.ci/windows` makes.
"""

import contextlib
import errno
import sys

sys.modules["_wmi"] = None  # platform.uname() crashes in Wine's WMI

import _thread
import _winapi
import msvcrt
import os

if hasattr(_winapi, "CopyFile2"):  # it crashes; without it, shutil.copy2 copies by itself
    del _winapi.CopyFile2

_chmod, _kill, _locking = os.chmod, os.kill, msvcrt.locking
_KEYS = {0: "SIGINT", 1: "SIGBREAK"}  # by the number of CTRL_C_EVENT and CTRL_BREAK_EVENT
_PRIVILEGE_NOT_HELD = 1314
_EVENT_MODIFY_STATE, _STATUS_CONTROL_C_EXIT = 2, 0xC000013A - (1 << 32)


def _chmod_even_of_mapped_files(path, mode, **options):
    """Ignore Wine's sharing violation for a memory-mapped file (`tasks.db-shm`)."""
    with contextlib.suppress(PermissionError):
        _chmod(path, mode, **options)


def _locking_with_error_number(descriptor, mode, count):
    """Give the error number that Windows gives for a locked region; Wine gives any."""
    try:
        _locking(descriptor, mode, count)
    except OSError:
        raise OSError(errno.EACCES, "Permission denied") from None


def _kill_with_keys(pid, number):
    """Deliver Ctrl-C and Ctrl-Break, which Wine sends to no other process, through events."""
    if number in _KEYS:
        event = _winapi.OpenEventW(_EVENT_MODIFY_STATE, False, _event_name(pid, number))
        if event is None:  # no Python: such a program has no handlers, and ends
            _kill(pid, 15)
            return
        _winapi.SetEvent(event)
        _winapi.CloseHandle(event)
    else:
        _kill(pid, number)


def _symlink_without_the_right(source, link, target_is_directory=False, *, dir_fd=None):
    """Refuse as Windows does for most users; Wine reports success and makes no link."""
    problem = "A required privilege is not held by the client"
    raise OSError(errno.EINVAL, problem, source, _PRIVILEGE_NOT_HELD, link)


def _event_name(pid, key):
    return f"taskrpc-key-{pid}-{key}"


def _await_key(event, name):
    """Do at a key what Windows does: call its handler on a thread of its own, or end."""
    while _winapi.WaitForSingleObject(event, _winapi.INFINITE) == _winapi.WAIT_OBJECT_0:
        import signal

        number = getattr(signal, name)
        handler = signal.getsignal(number)
        if handler == signal.SIG_DFL:
            os._exit(_STATUS_CONTROL_C_EXIT)
        if handler != signal.SIG_IGN:
            signal.raise_signal(number)


os.chmod, msvcrt.locking = _chmod_even_of_mapped_files, _locking_with_error_number
os.kill, os.symlink = _kill_with_keys, _symlink_without_the_right
sys.ctrl_c_reaches_one_process = True
for _number, _name in _KEYS.items():
    _event = _winapi.CreateEventW(0, False, False, _event_name(os.getpid(), _number))
    _thread.start_new_thread(_await_key, (_event, _name))


class _Absent:
    """Hides packages whose DLLs call functions that Wine's ucrtbase and bcrypt lack."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Skip the test that imports such a package; outside tests it is not installed."""
        if name not in ("numpy", "cryptography"):
            return
        reason = f"{name} cannot be loaded in Wine"
        if "_pytest.outcomes" in sys.modules:
            import pytest

            pytest.skip(reason, allow_module_level=True)
        raise ModuleNotFoundError(reason, name=name)


sys.meta_path.insert(0, _Absent)
