"""The filter for system calls: an interpreter of its few instructions decides about calls."""

import struct

import pytest

from taskrpc.course.labs.sandbox.system_calls import filter_for

ALLOWED, KILLED, REFUSED, MISSING = 0x7FFF0000, 0x80000000, 0x00050001, 0x00050026
X86, ARM = ("x86_64", 0xC000003E), ("aarch64", 0xC00000B7)


def decision(machine, architecture, number, argument=0):
    """Run the filter as the kernel does."""
    data = struct.pack("=IIQQ", number, architecture, 0, argument)
    code = list(struct.iter_unpack("=HBBI", filter_for(machine)))
    at = loaded = 0
    while True:
        operation, if_true, if_false, value = code[at]
        at += 1
        if operation == 0x20:
            (loaded,) = struct.unpack_from("=I", data, value)
        elif operation == 0x06:
            return value
        else:
            holds = {0x15: loaded == value, 0x35: loaded >= value, 0x45: bool(loaded & value)}
            at += if_true if holds[operation] else if_false


@pytest.mark.parametrize(
    ("system", "number", "argument", "expected"),
    [
        (X86, 0, 0, ALLOWED),  # read
        (X86, 319, 0, REFUSED),  # memfd_create
        (ARM, 279, 0, REFUSED),
        (X86, 29, 0, REFUSED),  # shmget
        (X86, 272, 0, REFUSED),  # unshare
        (X86, 435, 0, MISSING),  # clone3
        (X86, 56, 0x11, ALLOWED),  # clone as fork does
        (ARM, 220, 0x11, ALLOWED),
        (X86, 56, 0x10000011, REFUSED),  # with a user namespace
        (X86, 57, 0, ALLOWED),
        (X86, 0x40000000, 0, REFUSED),
    ],
)
def test_calls_that_no_limit_covers_are_refused(system, number, argument, expected):
    assert decision(*system, number, argument) == expected


def test_calls_with_the_numbers_of_another_processor_end_the_program():
    assert decision("x86_64", 0x40000003, 0) == KILLED


def test_an_unknown_processor_has_no_filter():
    assert filter_for("riscv64") == b""
