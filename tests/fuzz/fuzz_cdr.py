"""Coverage-guided fuzzing of the CDR decoder: garbage gives CdrError or a message, never more.

    pip install atheris
    python -m tests.fuzz.fuzz_cdr -max_total_time=300 [a folder for the inputs that were found]

from the root of a checkout. The first byte of an input chooses the class, the rest is the data.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from types import FunctionType
from typing import Any

from srvgen import CdrError, define, from_cdr, load, to_cdr
from srvgen.cdr.messages import _decoders
from tests.srvgen.cdr.reference import random_message

EVERYTHING = f"""bool flag
byte raw
char letter
float32 ratio
float64 exact
int16 c
uint64 h
string name
string<=5 short
wstring wide
wstring<=3 narrow
Inner inner
Empty nothing
bool[] flags
bool[3] three
byte[2] pair
byte[] bytes
string[<=3] names
string<=4[2] codes
wstring[] wides
float32[] ranges
float64[3] covariance
uint8[] image
int64[<=3] longs
float64[] exacts
Inner[] inners
Inner[2] two
Empty[] nothings

{"=" * 80}
MSG: demo_msgs/msg/Inner
uint8 a
float64 b
string c
int16[] d

{"=" * 80}
MSG: demo_msgs/msg/Empty
"""
"""A definition with a field of every kind, in an order that needs every kind of padding."""

TYPES = (
    "nav_msgs/msg/Path",
    "sensor_msgs/msg/LaserScan",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rcl_interfaces/msg/ParameterEvent",
    "example_interfaces/msg/WString",
)


def decode_or_refuse(cls: Any, data: bytes, decode: Callable[[Any, bytes], Any] = from_cdr) -> None:
    """Decode, and check the decoder's promises.

    Raises:
        AssertionError: the message does not pass its own check, or is not what the data said.
        Exception: the decoder raised an undocumented exception.
    """
    try:
        message = decode(cls, data)
    except CdrError:
        return
    before = repr(message)
    again = to_cdr(message)
    assert repr(message) == before
    assert repr(from_cdr(cls, again)) == before
    # Nothing was passed over but padding at the end; strings without NUL only get longer.
    assert len(data) - 3 <= len(again)


@cache
def classes() -> tuple[Any, ...]:
    """The class that the fuzzer decodes to."""
    return (define("demo_msgs/msg/Everything", EVERYTHING), *map(load, TYPES))


def one_input(data: bytes) -> None:
    """The function that the fuzzer calls."""
    if data:
        decode_or_refuse(classes()[data[0] % len(classes())], data[1:])


def compiled_decoders(function: FunctionType, found: set[FunctionType]) -> set[FunctionType]:
    """A compiled decoder, with the decoders of sequences that it calls."""
    if function.__code__.co_filename.startswith("<srvgen CDR") and function not in found:
        found.add(function)
        for one in function.__globals__.values():
            if isinstance(one, FunctionType):
                compiled_decoders(one, found)
    return found


def main() -> None:
    """Fuzz until the limit in the options."""
    import atheris

    with tempfile.TemporaryDirectory() as seeds:
        for number, cls in enumerate(classes()):
            for most in range(4):
                data = to_cdr(random_message(cls, Random(most), most))
                decode_or_refuse(cls, data)
                Path(seeds, f"{number}-{most}").write_bytes(bytes((number,)) + data)
            # They are in no module, where the next line would find them.
            for decoder in compiled_decoders(_decoders[cls], set()):
                atheris.instrument_func(decoder)
        atheris.instrument_all()
        atheris.Setup([*sys.argv, seeds], one_input)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
