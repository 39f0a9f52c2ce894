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
    "test_msgs/action/Fibonacci": (
        "RIHS01_be9273e3557225044b4a040811112491f7079326e3a573f83258b0b4c30bd069"
    ),
    "test_msgs/action/Fibonacci_Feedback": (
        "RIHS01_7d1110f2efa019ad5ad8ad2244db98d862f39dc9fae8c976814b0065fa2f32d5"
    ),
    "test_msgs/action/Fibonacci_FeedbackMessage": (
        "RIHS01_37487bae8cea358366b97003c1ef1ca7ce7c08df36f9e8cca496624226aee64e"
    ),
    "test_msgs/action/Fibonacci_GetResult": (
        "RIHS01_5d30fdeb21d20e117aa5f36c7b4f0b6874f1a8cf7a9c038d58f1156c5737b209"
    ),
    "test_msgs/action/Fibonacci_GetResult_Event": (
        "RIHS01_fe0aa5843ef10550a9b322aeeccd5b11e78bca05b3571cf6999c51bff30c1e23"
    ),
    "test_msgs/action/Fibonacci_GetResult_Request": (
        "RIHS01_c65e93c4c4328d7f1abd6ace83dba8e5fa0f32de76b4d2c96b5c655d94803b92"
    ),
    "test_msgs/action/Fibonacci_GetResult_Response": (
        "RIHS01_ef88159d47a3d21d9bf4bec690cf668939d9542db28a9cfd77dbcd97eaf1add2"
    ),
    "test_msgs/action/Fibonacci_Goal": (
        "RIHS01_e58ef5a8f4f039ab522a740823547c460b1d5aed8031c8b7825d33d345d90df8"
    ),
    "test_msgs/action/Fibonacci_Result": (
        "RIHS01_0774b095467813c6904d475498b5486b7ebd4cda6a4569f97e8de8c862689049"
    ),
    "test_msgs/action/Fibonacci_SendGoal": (
        "RIHS01_d807633803e38e164276573cd97e9fbd71e109c290bbf4cc312a0a1c9da7bbd9"
    ),
    "test_msgs/action/Fibonacci_SendGoal_Event": (
        "RIHS01_a20e708c6aae7a99d1eb0e930a0916f596bb5bae93a342a61752e13135be2c44"
    ),
    "test_msgs/action/Fibonacci_SendGoal_Request": (
        "RIHS01_dfe75c73dc2c090cbc8fd8c45039bfa279d16aa6aadd348f812c6adad26e669e"
    ),
    "test_msgs/action/Fibonacci_SendGoal_Response": (
        "RIHS01_1e7e84f7edf1fb020d9e51c7842bceef4cbdbd847f354125f3227cf4f314a683"
    ),
    "action_msgs/srv/CancelGoal": (
        "RIHS01_573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"
    ),
    "action_msgs/msg/GoalStatusArray": (
        "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e"
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
