"""Reads bags of MCAP and SQLite files, with or without their metadata.yaml."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from rclpy.duration import Duration
from rclpy.time import Time

from taskrpc.observe.recording.mcap_file import Message, Topic
from taskrpc.observe.recording.sqlite_file import open_recording

from .storage import (
    METADATA,
    BagMetadata,
    ConverterOptions,
    Count,
    StorageFilter,
    StorageOptions,
    TopicInformation,
    TopicMetadata,
    profile,
    read_metadata,
    runtime_errors,
)


class SequentialReader:
    """Reads a bag message by message: MCAP in the order of the file, SQLite in that of time."""

    def __init__(self) -> None:
        self._bag: _Bag | None = None
        self._filter = StorageFilter()
        self._from = 0
        """The time of `seek`."""
        self._position = 0
        """How many messages of the bag are behind the reader."""
        self._messages: Iterator[tuple[int, Message]] = iter(())
        self._next: tuple[int, Message] | None = None

    def open(self, storage_options: StorageOptions, converter_options: ConverterOptions) -> None:
        """Open a folder, or a file in it. Raises RuntimeError."""
        if converter_options.output_serialization_format not in ("", "cdr"):
            raise RuntimeError(f"expected ConverterOptions('', ''), got {converter_options}")
        self._bag = _Bag(storage_options.uri, storage_options.storage_id)
        self._filter = StorageFilter()
        self.seek(0)

    def open_uri(self, uri: str) -> None:
        """Open a folder, or a file in it, of any format. Raises RuntimeError."""
        self.open(StorageOptions(uri), ConverterOptions())

    def close(self) -> None:
        """Close the bag."""
        self._bag = None
        self._messages, self._next = iter(()), None

    def has_next(self) -> bool:
        """Whether `read_next` will return a message."""
        self._opened()
        if self._next is None:
            self._next = next(self._messages, None)
        return self._next is not None

    def read_next(self) -> tuple[str, bytes, int]:
        """The topic, the serialized message, and its time in nanoseconds since 1970.

        Raises RuntimeError after the last message.
        """
        if not self.has_next() or self._next is None:
            raise RuntimeError("the bag has no more messages: call has_next() before read_next()")
        (index, message), self._next = self._next, None
        self._position = index + 1
        return message.topic.name, message.data, message.time

    def get_all_topics_and_types(self) -> list[TopicMetadata]:
        """The topics of the bag; the filter changes nothing."""
        return [each.topic_metadata for each in self.get_metadata().topics_with_message_count]

    def get_metadata(self) -> BagMetadata:
        """What metadata.yaml says; without this file, what the bag contains."""
        return self._opened().metadata()

    def set_filter(self, storage_filter: StorageFilter) -> None:
        """Return only messages of these topics from now on."""
        self._opened()
        self._filter = storage_filter
        self._restart()

    def reset_filter(self) -> None:
        """Return the messages of all topics from now on."""
        self.set_filter(StorageFilter())

    def seek(self, timestamp: int) -> None:
        """Continue with the first message at this time, or after it; also backwards."""
        self._opened()
        self._from, self._position = timestamp, 0
        self._restart()

    def _restart(self) -> None:
        # From the beginning: `has_next` may have skipped messages that pass now.
        self._messages, self._next = self._remaining(self._opened()), None

    def _remaining(self, bag: _Bag) -> Iterator[tuple[int, Message]]:
        for index, message in enumerate(bag.messages()):
            if index < self._position or message.time < self._from:
                continue
            if self._filter.passes(message.topic.name):
                yield index, message

    def _opened(self) -> _Bag:
        if self._bag is None:
            raise RuntimeError("expected an open bag: call open(storage_options, …) first")
        return self._bag


class Info:
    """Returns what is known about a bag."""

    def read_metadata(self, uri: str, storage_id: str = "") -> BagMetadata:
        """What metadata.yaml says; without it, what the bag contains. Raises RuntimeError."""
        return _Bag(uri, storage_id).metadata()


class _Bag:
    """The files of a bag."""

    def __init__(self, uri: str, storage_id: str) -> None:
        self._path = Path(uri)
        if storage_id not in ("", "mcap", "sqlite3"):
            raise RuntimeError(f"expected storage_id 'mcap', 'sqlite3' or '', got {storage_id!r}")
        if not self._path.exists():
            raise RuntimeError(f"expected the folder of a bag, {uri!r} does not exist")
        self._metadata: BagMetadata | None = None
        if (described := self._path / METADATA).is_file():
            self._metadata = read_metadata(described)
        with runtime_errors():
            self._recording = open_recording(self._path)
        found = self._recording.storage_id
        if storage_id not in ("", found):
            raise RuntimeError(
                f"{uri} is a bag of storage_id={found!r}, expected {storage_id!r}; storage_id=''"
                " reads both"
            )

    def messages(self) -> Iterator[Message]:
        """The messages of all files. A damaged part is reported on standard error."""
        with runtime_errors():
            yield from self._recording.messages()
        if problem := self._recording.problem:
            print(f"[taskrpc] WARNING: {problem}", file=sys.stderr)

    def metadata(self) -> BagMetadata:
        """The contents of metadata.yaml; without it, those of the bag are counted."""
        if self._metadata is None:
            self._metadata = self._counted()
        self._metadata.bag_size = self._recording.size
        return self._metadata

    def _counted(self) -> BagMetadata:
        total, counts = Count(), dict[str, tuple[Topic, Count]]()
        for message in self.messages():
            topic = message.topic
            total.add(message.time)
            counts.setdefault(topic.name, (topic, Count()))[1].add(message.time)
        for topic in self._recording.topics.values():
            counts.setdefault(topic.name, (topic, Count()))  # it has no messages
        return BagMetadata(
            storage_identifier=self._recording.storage_id,
            duration=Duration(nanoseconds=total.span),
            starting_time=Time(nanoseconds=total.first),
            message_count=total.messages,
            topics_with_message_count=[
                TopicInformation(
                    TopicMetadata(
                        number, each.name, each.type_name, each.encoding, [profile(each.qos)]
                    ),
                    count.messages,
                )
                for number, (each, count) in enumerate(counts.values(), 1)
            ],
        )
