"""The descriptions that readers and writers take and return, and the file metadata.yaml."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time

from taskrpc.observe.recording.mcap_file import RecordingError, one_line, qos_from, qos_text
from taskrpc.qos import QoS

METADATA = "metadata.yaml"
"""The file of a bag that describes the others."""
NO_TIME = 2**63 - 1
"""The starting time of a bag without messages."""
_VERSION = 9
"""The version of metadata.yaml that ROS 2 Jazzy writes."""


@dataclass
class StorageOptions:
    """Where a bag is, and its format; options about splitting and caching have no effect."""

    uri: str
    """The folder of the bag."""
    storage_id: str = ""
    """`mcap`, or "" for it; a reader also accepts `sqlite3`."""
    max_bagfile_size: int = 0
    max_bagfile_duration: int = 0
    max_cache_size: int = 0
    storage_preset_profile: str = ""
    storage_config_uri: str = ""
    snapshot_mode: bool = False
    start_time_ns: int = -1
    end_time_ns: int = -1
    custom_data: dict[str, str] = field(default_factory=dict)
    """What to write into metadata.yaml besides."""


@dataclass
class ConverterOptions:
    """The encodings of messages in memory and in the bag; only `cdr`, or "" for it."""

    input_serialization_format: str = ""
    output_serialization_format: str = ""


@dataclass
class TopicMetadata:
    """A topic of a bag. ROS 2 Jazzy needs the `id`, and Humble does not have it."""

    id: int = 0
    name: str = ""
    type: str = ""
    serialization_format: str = ""
    offered_qos_profiles: Any = field(default_factory=list)
    """Profiles of the topic's publishers; Humble has a text in YAML."""
    type_description_hash: str = ""

    def equals(self, other: TopicMetadata) -> bool:
        """Whether both describe the same topic."""
        return self == other


@dataclass
class TopicInformation:
    """A topic of a bag, and how many messages it has."""

    topic_metadata: TopicMetadata
    message_count: int


@dataclass
class FileInformation:
    """A file of a bag, and which messages it has."""

    path: str
    starting_time: Time
    duration: Duration
    message_count: int


@dataclass
class BagMetadata:
    """What metadata.yaml says about a bag."""

    version: int = _VERSION
    bag_size: int = 0
    """Bytes of the files with messages."""
    storage_identifier: str = ""
    relative_file_paths: list[str] = field(default_factory=list)
    files: list[FileInformation] = field(default_factory=list)
    duration: Duration = field(default_factory=Duration)
    starting_time: Time = field(default_factory=Time)
    message_count: int = 0
    topics_with_message_count: list[TopicInformation] = field(default_factory=list)
    compression_format: str = ""
    compression_mode: str = ""
    custom_data: dict[str, str] = field(default_factory=dict)
    ros_distro: str = ""


@dataclass
class StorageFilter:
    """Which topics a reader returns; without any, all."""

    topics: Sequence[str] = ()
    services_events: Sequence[str] = ()
    """Topics of the events of services, such as `/reset/_service_event`."""
    regex: str = ""
    """Topics that it matches are returned too."""
    exclude_topics: Sequence[str] = ()
    exclude_service_events: Sequence[str] = ()
    regex_to_exclude: str = ""

    def passes(self, topic: str) -> bool:
        """Whether the reader returns the messages of this topic."""
        if topic in (*self.exclude_topics, *self.exclude_service_events):
            return False
        if self.regex_to_exclude and re.fullmatch(self.regex_to_exclude, topic):
            return False
        named = (*self.topics, *self.services_events)
        if not named and not self.regex:
            return True
        return topic in named or bool(self.regex and re.fullmatch(self.regex, topic))


@contextmanager
def runtime_errors() -> Iterator[None]:
    """Raise the errors of recordings as the RuntimeError that programs for ROS expect."""
    try:
        yield
    except RecordingError as error:
        raise RuntimeError(str(error)) from None


def get_default_storage_id() -> str:
    """The format of bags if none is chosen."""
    return "mcap"


class Count:
    """Counts messages, and keeps the times of the first and the last."""

    def __init__(self) -> None:
        self.messages = 0
        self.first = NO_TIME
        self.last = 0

    def add(self, time: int) -> None:
        """Add a message with its time in nanoseconds since 1970."""
        self.messages += 1
        self.first, self.last = min(self.first, time), max(self.last, time)

    @property
    def span(self) -> int:
        """Nanoseconds between the first message and the last."""
        return max(0, self.last - self.first)


def native_qos(profiles: Any) -> QoS:
    """The first of the profiles of a topic; the default if there is none."""
    if isinstance(profiles, str):
        return qos_from(profiles)
    first = next(iter(profiles or ()), None)
    return first.to_native() if isinstance(first, QoSProfile) else QoS()


def profile(qos: QoS) -> QoSProfile:
    """The profile of a topic, for programs."""
    return QoSProfile(
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
    )


def metadata_text(
    file: str, topics: Sequence[tuple[TopicMetadata, Count]], total: Count, custom: dict[str, str]
) -> str:
    """The text of metadata.yaml for a bag with one MCAP file."""
    described = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type,
                "serialization_format": topic.serialization_format,
                "offered_qos_profiles": yaml.safe_load(
                    qos_text(native_qos(topic.offered_qos_profiles))
                ),
                "type_description_hash": topic.type_description_hash,
            },
            "message_count": count.messages,
        }
        for topic, count in topics
    ]
    information = {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **_span(total),
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file],
        "files": [{"path": file, **_span(total)}],
        "custom_data": custom or None,
        "ros_distro": "taskrpc",
    }
    return yaml.safe_dump(
        {"rosbag2_bagfile_information": information}, sort_keys=False, allow_unicode=True
    )


def _span(total: Count) -> dict[str, Any]:
    # A new dict for each use: YAML would write the second one as a reference.
    return {
        "duration": {"nanoseconds": total.span},
        "starting_time": {"nanoseconds_since_epoch": total.first},
        "message_count": total.messages,
    }


def read_metadata(path: Path) -> BagMetadata:
    """What a file metadata.yaml says. Raises RuntimeError if it is not such a file."""
    try:
        loaded: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
        return _metadata(loaded["rosbag2_bagfile_information"])
    except KeyError as missing:
        raise RuntimeError(f"cannot read {path}: expected {missing} in it") from None
    except (OSError, TypeError, ValueError, AttributeError, yaml.YAMLError) as error:
        raise RuntimeError(f"cannot read {path}: {one_line(error)}") from None


def _metadata(read: dict[str, Any]) -> BagMetadata:
    topics = []
    for number, each in enumerate(read["topics_with_message_count"], 1):
        topic = each["topic_metadata"]
        profiles = topic.get("offered_qos_profiles", "")  # a text up to ROS 2 Iron, then a list
        text = profiles if isinstance(profiles, str) else yaml.safe_dump(profiles)
        described = TopicMetadata(
            number,
            topic["name"],
            topic["type"],
            topic["serialization_format"],
            [profile(qos_from(text))],
            topic.get("type_description_hash", ""),
        )
        topics.append(TopicInformation(described, each["message_count"]))
    return BagMetadata(
        version=read["version"],
        storage_identifier=read["storage_identifier"],
        relative_file_paths=read["relative_file_paths"],
        files=[
            FileInformation(each["path"], *_times(each), each["message_count"])
            for each in read.get("files") or []
        ],
        starting_time=_times(read)[0],
        duration=_times(read)[1],
        message_count=read["message_count"],
        topics_with_message_count=topics,
        compression_format=read.get("compression_format", ""),
        compression_mode=read.get("compression_mode", ""),
        custom_data=read.get("custom_data") or {},
        ros_distro=read.get("ros_distro", ""),
    )


def _times(read: dict[str, Any]) -> tuple[Time, Duration]:
    start = read["starting_time"]["nanoseconds_since_epoch"]
    return Time(nanoseconds=start), Duration(nanoseconds=read["duration"]["nanoseconds"])
