"""Keys are those of rmw_zenoh; names and types survive a round trip."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.middleware.zenoh import keys

NAMES = st.from_regex(r"/[a-z_]\w{0,9}(/[a-z_]\w{0,9}){0,3}", fullmatch=True)
TYPES = st.from_regex(r"[a-z]\w{0,9}/(srv|msg)/[A-Z]\w{0,9}", fullmatch=True)


def test_the_key_of_a_service_is_that_of_rmw_zenoh():
    key = keys.data_key(0, "/add_two_ints", "example_interfaces/srv/AddTwoInts", "RIHS01_e1")
    assert key == "0/add_two_ints/example_interfaces::srv::dds_::AddTwoInts_/RIHS01_e1"


def test_a_key_keeps_the_slashes_inside_of_a_name():
    key = keys.data_key(7, "/robot/arm/pose", "geometry_msgs/msg/Pose", "RIHS01_e1")
    assert key == "7/robot/arm/pose/geometry_msgs::msg::dds_::Pose_/RIHS01_e1"


@given(NAMES)
def test_names_survive_mangling(name):
    assert "/" not in keys.mangle(name)
    assert keys.demangle(keys.mangle(name)) == name


def test_an_empty_name_is_a_single_percent_sign():
    assert keys.mangle("") == keys.mangle("/") == "%"


@given(TYPES)
def test_types_survive_a_round_trip(type_name):
    assert keys.ros_type(keys.dds_type(type_name)) == type_name


@given(st.text())
def test_other_texts_are_no_error(text):
    keys.ros_type(text)
    keys.dds_type(text)
    keys.address_of(text)


@pytest.mark.parametrize("address", ["", "*", "**", "a/b", "a*", "A1", "x" * 16, "a" * 33, "a\n"])
def test_an_address_cannot_be_a_wildcard(address):
    assert not keys.is_address(address)
    assert keys.address_of(f"taskrpc/0/alive/{address}") in ("", "b")


def test_the_address_of_a_program_is_the_last_part_of_its_keys():
    for key in (keys.alive_key(3, "ab12"), keys.entry_key(3, "ab12"), keys.inbox_key(3, "ab12")):
        assert key.startswith("taskrpc/3/")
        assert keys.address_of(key) == "ab12"
