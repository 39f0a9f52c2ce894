"""The memory of large messages is used again."""

import subprocess
import sys
from platform import libc_ver

import pytest

_LARGE_MESSAGES = """
import resource, sys
from taskrpc.core.system import resources
if sys.argv[1] == "kept":
    resources.keep_freed_memory(16 * 2**20)
pages = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
before = pages()
for _ in range(20):
    parts = [bytearray(2**18) for _ in range(4)]
    message = b"".join(parts)
    del parts, message
print((pages() - before) // 20)
"""


@pytest.mark.skipif(libc_ver()[0] != "glibc", reason="this allocator gives nothing back")
def test_memory_of_large_messages_is_used_again():
    """Counts the pages that the system must make for each message of 1 MiB."""
    new_pages = {
        how: int(subprocess.check_output([sys.executable, "-c", _LARGE_MESSAGES, how]))
        for how in ("kept", "given back")
    }
    assert new_pages["kept"] < new_pages["given back"] / 4, new_pages
