"""The descriptions of bags, and metadata.yaml."""

import importlib

import pytest
import yaml


@pytest.fixture
def storage(ros_names):
    return importlib.import_module("rosbag2_py.storage")


@pytest.mark.parametrize(
    ("chosen", "passing"),
    [
        ({}, ["/a", "/b", "/ab"]),
        ({"topics": ["/a"]}, ["/a"]),
        ({"topics": ["/a"], "regex": "/b"}, ["/a", "/b"]),
        ({"regex": "/a.*"}, ["/a", "/ab"]),
        ({"exclude_topics": ["/a"]}, ["/b", "/ab"]),
        ({"regex": "/.*", "regex_to_exclude": ".*b"}, ["/a"]),
        ({"services_events": ["/b"]}, ["/b"]),
    ],
)
def test_filter_chooses_topics(storage, chosen, passing):
    found = storage.StorageFilter(**chosen)
    assert [topic for topic in ("/a", "/b", "/ab") if found.passes(topic)] == passing


def test_metadata_is_read_as_it_was_written(storage, tmp_path):
    topic = storage.TopicMetadata(0, "/a", "std_msgs/msg/String", "cdr", [], "RIHS01_12")
    count = storage.Count()
    for time in (7, 5, 6):
        count.add(time)
    path = tmp_path / "metadata.yaml"
    path.write_text(storage.metadata_text("a_0.mcap", [(topic, count)], count, {"key": "ä"}))
    read = storage.read_metadata(path)
    assert (read.starting_time.nanoseconds, read.duration.nanoseconds) == (5, 2)
    assert (read.message_count, read.files[0].message_count) == (3, 3)
    assert (read.custom_data, read.ros_distro) == ({"key": "ä"}, "taskrpc")
    [found] = read.topics_with_message_count
    assert (found.message_count, found.topic_metadata.type_description_hash) == (3, "RIHS01_12")


def test_bag_without_messages_has_no_duration(storage, tmp_path):
    path = tmp_path / "metadata.yaml"
    path.write_text(storage.metadata_text("a_0.mcap", [], storage.Count(), {}))
    read = storage.read_metadata(path)
    assert (read.duration.nanoseconds, read.message_count) == (0, 0)
    assert read.starting_time.nanoseconds == storage.NO_TIME


def test_metadata_of_older_versions_is_read(storage, tmp_path):
    """Version 4 has no files, and the QoS as a text."""
    topic = {
        "name": "/a",
        "type": "std_msgs/msg/String",
        "serialization_format": "cdr",
        "offered_qos_profiles": "- depth: 3\n  reliability: 2\n  durability: 2\n",
    }
    information = {
        "version": 4,
        "storage_identifier": "sqlite3",
        "relative_file_paths": ["a_0.db3"],
        "duration": {"nanoseconds": 1},
        "starting_time": {"nanoseconds_since_epoch": 2},
        "message_count": 4,
        "topics_with_message_count": [{"topic_metadata": topic, "message_count": 4}],
    }
    path = tmp_path / "metadata.yaml"
    path.write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    [found] = storage.read_metadata(path).topics_with_message_count
    [profile] = found.topic_metadata.offered_qos_profiles
    assert (profile.depth, profile.reliability.name) == (3, "BEST_EFFORT")


@pytest.mark.parametrize("text", ["", "[1]", "a: b: c", "rosbag2_bagfile_information: {}"])
def test_other_files_are_an_error_of_one_line(storage, tmp_path, text):
    path = tmp_path / "metadata.yaml"
    path.write_text(text)
    with pytest.raises(RuntimeError, match=r"cannot read .*metadata\.yaml: ") as caught:
        storage.read_metadata(path)
    assert "\n" not in str(caught.value)
