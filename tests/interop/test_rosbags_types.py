"""rosbags, which knows ROS's types by its own definitions, agrees on type hashes and CDR data."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import srvgen
from srvgen.errors import DefinitionError

STORE = get_typestore(Stores.ROS2_JAZZY)
WRONG_HASHES = {"std_msgs/msg/Char", "service_msgs/msg/ServiceEventInfo"}
"""rosbags has a type `char` of its own; in ROS 2 a `char` of a .msg file is a uint8."""


def known(name):
    try:
        srvgen.load(name)
    except DefinitionError:
        return False
    return True


SHARED = sorted(name for name in STORE.types if "/msg/" in name and known(name))


def test_most_message_types_are_shared():
    assert len(SHARED) >= 150


@pytest.mark.parametrize("name", SHARED)
def test_type_hash_is_that_of_rosbags(name):
    if name not in WRONG_HASHES:
        assert srvgen.type_hash(name) == STORE.hash_rihs01(name)


def filled(cls, numbers):
    """A message in which each field has a value of its own."""
    message = cls()
    for field, kind in cls.get_fields_and_field_types().items():
        value = getattr(message, field)
        if isinstance(value, bool):
            value = True
        elif isinstance(value, int | float):
            value = type(value)(next(numbers) % 100)
        elif isinstance(value, bytes):
            value = bytes([next(numbers)])
        elif isinstance(value, str):
            value = f"é{next(numbers)}"
        elif hasattr(value, "get_fields_and_field_types"):
            value = filled(type(value), numbers)
        elif kind.startswith("sequence<string"):
            value = ["", f"text {next(numbers)}"]
        elif kind.startswith("sequence<") and "/" not in kind:
            value = [next(numbers) % 2 for _ in range(3)]
        setattr(message, field, value)
    return message


def agree(ours, theirs):
    if hasattr(ours, "get_fields_and_field_types"):
        fields = ours.get_fields_and_field_types()
        return all(agree(getattr(ours, field), getattr(theirs, field)) for field in fields)
    if isinstance(theirs, list | np.ndarray):
        return len(ours) == len(theirs) and all(map(agree, ours, theirs))
    if isinstance(ours, bytes):  # rclpy's value of a `byte`
        return ours[0] == int(theirs) % 256
    return ours == theirs or (math.isnan(ours) and math.isnan(theirs))


@pytest.mark.parametrize("name", SHARED)
def test_rosbags_reads_and_writes_the_same_cdr_data(name):
    message = filled(srvgen.load(name), itertools.count(1))
    data = srvgen.to_cdr(message)
    read = STORE.deserialize_cdr(data, name)
    assert agree(message, read)
    assert srvgen.from_cdr(type(message), bytes(STORE.serialize_cdr(read, name))) == message
