"""RIHS01 hashes are equal to those of ROS 2."""

import pytest

from srvgen.files.search import Search
from srvgen.parser import parse_msg
from srvgen.typehash import hash_of, type_description

KNOWN = {
    "example_interfaces/srv/AddTwoInts": (
        "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    ),
    "std_srvs/srv/Trigger": (
        "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    ),
    "std_srvs/srv/SetBool": (
        "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a"
    ),
    "std_msgs/msg/String": (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    ),
    "example_interfaces/action/Fibonacci": (
        "RIHS01_9508051da1ea4658de144b09bd0690ff3de52104683d847aed764d2915906f51"
    ),
    "example_interfaces/action/Fibonacci_SendGoal": (
        "RIHS01_d1a57fb2a4afe8c21e34fb10db206f16ce6729b28531141472df92277c55b557"
    ),
    "example_interfaces/action/Fibonacci_GetResult_Event": (
        "RIHS01_ac4e9cdb954c2e192c9f0753d46f59ab6f0101d5fb5b9542fd8ab2906e40c4d9"
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_a_hash_is_the_official_one(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    search = Search()
    assert hash_of(search.load(name), search.load) == KNOWN[name]


def unknown(name):
    raise AssertionError(f"{name} was asked for")


def described(text):
    message = parse_msg(text, "my_msgs", "Any")
    return type_description(message, unknown)["type_description"]["fields"]


def test_an_empty_message_has_one_hidden_member():
    assert [field["name"] for field in described("")] == ["structure_needs_at_least_one_member"]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("byte", (16, 0, 0)),
        ("char", (3, 0, 0)),
        ("wstring<=4", (22, 0, 4)),
        ("string<=4[]", (165, 0, 4)),
        ("bool[3]", (63, 3, 0)),
        ("float64[<=3]", (107, 3, 0)),
    ],
)
def test_a_type_is_described_by_number_capacity_and_length(kind, expected):
    (field,) = described(f"{kind} x")
    found = field["type"]
    assert (found["type_id"], found["capacity"], found["string_capacity"]) == expected


def test_comments_defaults_and_constants_do_not_change_a_hash():
    plain = parse_msg("int32 a", "my_msgs", "Any")
    rich = parse_msg("# Much to say.\nint32 a 5 # [m]\nint32 A=1", "my_msgs", "Any")
    assert hash_of(plain, unknown) == hash_of(rich, unknown)
