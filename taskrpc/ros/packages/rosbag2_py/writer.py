"""Writes a bag: a folder with an MCAP file and metadata.yaml."""

from __future__ import annotations

import dataclasses
import threading
import weakref
from pathlib import Path

import srvgen
from srvgen.classes.loader import search
from taskrpc.observe.recording.mcap_file import RecordingError, RecordingWriter, one_line
from taskrpc.observe.recording.schemas import is_event, schema_text

from .storage import (
    METADATA,
    ConverterOptions,
    Count,
    StorageOptions,
    TopicMetadata,
    metadata_text,
    native_qos,
    runtime_errors,
)


class SequentialWriter:
    """Writes a new bag. The end of the program closes it too, or the end of the writer."""

    def __init__(self) -> None:
        self._bag: _Bag | None = None

    def open(self, storage_options: StorageOptions, converter_options: ConverterOptions) -> None:
        """Create the folder of the bag.

        Raises RuntimeError if it exists or cannot be created, or for a format other than MCAP.
        """
        if storage_options.storage_id not in ("", "mcap"):
            raise RuntimeError(
                f"expected storage_id='mcap', got {storage_options.storage_id!r}: taskrpc writes"
                " bags only as MCAP, the format of ROS 2 Jazzy"
            )
        formats = {
            converter_options.input_serialization_format,
            converter_options.output_serialization_format,
        }
        if not formats <= {"", "cdr"}:
            raise RuntimeError(f"expected ConverterOptions('', ''), got {converter_options}")
        self.close()
        self._bag = _Bag(Path(storage_options.uri), storage_options.custom_data)
        # Without a reference to the writer; Python calls it at the end of the program too.
        self._finish = weakref.finalize(self, self._bag.close)

    def create_topic(self, topic_with_type: TopicMetadata) -> None:
        """Add a topic; the same topic again changes nothing.

        Raises RuntimeError for an unknown type, or a topic that has another type.
        """
        self._opened().create_topic(topic_with_type)

    def write(self, topic_name: str, message: bytes, time_stamp: int) -> None:
        """Write a message.

        Args:
            topic_name: as given to `create_topic`.
            message: what `rclpy.serialization.serialize_message` returns.
            time_stamp: nanoseconds since 1970.

        Raises:
            TypeError: the message is not bytes, or the time is not a number.
            RuntimeError: the topic was not created, or the disk refuses the message.
        """
        bag = self._opened()
        if not isinstance(message, bytes | bytearray | memoryview):
            raise TypeError(
                f"{topic_name}: expected bytes, got {type(message).__name__}; write"
                " serialize_message(message), from rclpy.serialization"
            )
        if not isinstance(time_stamp, int) or not 0 <= time_stamp < 2**63:
            raise TypeError(
                f"{topic_name}: expected a time as nanoseconds since 1970, got {time_stamp!r};"
                " write for example node.get_clock().now().nanoseconds"
            )
        bag.write(topic_name, bytes(message), time_stamp)

    def close(self) -> None:
        """Finish the bag and write metadata.yaml; a second call changes nothing."""
        if self._bag is not None:
            self._bag = None
            self._finish()

    def _opened(self) -> _Bag:
        if self._bag is None:
            raise RuntimeError("expected an open bag: call open(storage_options, …) first")
        return self._bag


class _Bag:
    """A bag that is written; callbacks in several threads may write to it."""

    def __init__(self, folder: Path, custom: dict[str, str]) -> None:
        self._folder = folder.resolve()  # the program may change the working directory
        self._custom = dict(custom)
        self._lock = threading.Lock()
        self._topics: dict[str, tuple[TopicMetadata, int, Count]] = {}
        """By name: the topic, its number in the file, its messages."""
        self._total = Count()
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            problem = "it exists already; choose another uri, or remove it"
            raise RuntimeError(f"cannot record to {folder}: {problem}") from None
        except OSError as error:
            raise RuntimeError(f"cannot record to {folder}: {error.strerror}") from None
        with runtime_errors():
            self._file = RecordingWriter(self._folder / f"{self._folder.name}_0.mcap")

    def create_topic(self, topic: TopicMetadata) -> None:
        texts = (topic.name, topic.type, topic.serialization_format)
        if not all(isinstance(one, str) and one for one in texts) or texts[2] != "cdr":
            raise RuntimeError(
                "expected TopicMetadata(id=0, name='/chatter', type='std_msgs/msg/String',"
                f" serialization_format='cdr'), got id={topic.id!r}, name={topic.name!r},"
                f" type={topic.type!r}, serialization_format={topic.serialization_format!r}"
            )
        with self._lock:
            if topic.name in self._topics:
                earlier = self._topics[topic.name][0].type
                if earlier != topic.type:
                    problem = f"expected {earlier}, as in an earlier call, got {topic.type}"
                    raise RuntimeError(f"create_topic {topic.name}: {problem}")
                return
            try:
                schema = schema_text(topic.type, search())
                known = "" if is_event(topic.type) else srvgen.type_hash(topic.type)
            except (srvgen.DefinitionError, ValueError) as error:
                raise RuntimeError(f"create_topic {topic.name}: {one_line(error)}") from None
            topic = dataclasses.replace(
                topic, type_description_hash=topic.type_description_hash or known
            )
            with runtime_errors():
                number = self._file.add_topic(
                    topic.name,
                    topic.type,
                    schema,
                    type_hash=topic.type_description_hash,
                    qos=native_qos(topic.offered_qos_profiles),
                )
            self._topics[topic.name] = topic, number, Count()

    def write(self, name: str, data: bytes, time: int) -> None:
        with self._lock:
            if name not in self._topics:
                created = ", ".join(self._topics) or "none"
                raise RuntimeError(
                    f"expected a topic of create_topic ({created}), got {name!r}; call"
                    " create_topic before the first message"
                )
            _, number, count = self._topics[name]
            with runtime_errors():
                self._file.write(number, data, time)
            count.add(time)
            self._total.add(time)

    def close(self) -> None:
        with self._lock:
            topics = [(topic, count) for topic, _, count in self._topics.values()]
            text = metadata_text(self._file.path.name, topics, self._total, self._custom)
            try:
                self._file.close()
                (self._folder / METADATA).write_text(text, encoding="utf-8")
            except (RecordingError, OSError) as error:
                raise RuntimeError(f"cannot finish {self._folder}: {one_line(error)}") from None
