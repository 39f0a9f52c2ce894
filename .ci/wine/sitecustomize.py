"""Corrects what Wine 8 lacks of Windows, so that the tests see the product's faults and not Wine's.

Copied into the site-packages of the Windows Python that `.ci/windows` makes.
"""

import contextlib
import errno
import sys

sys.modules["_wmi"] = None  # platform.uname() crashes in Wine's WMI

import _winapi
import msvcrt
import os

if hasattr(_winapi, "CopyFile2"):  # it crashes; without it, shutil.copy2 copies by itself
    del _winapi.CopyFile2

_chmod, _locking = os.chmod, msvcrt.locking


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


os.chmod, msvcrt.locking = _chmod_even_of_mapped_files, _locking_with_error_number


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
