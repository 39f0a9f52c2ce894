"""Recording files: MCAP as rosbag2 writes it, without chunks.

Every message is handed to the operating system at once. So a recorder that is killed loses at most
the message that it was writing; chunks would lose up to a megabyte. `read` reads what is there: of
finished and of unfinished files, with and without chunks, also those of rosbag2.
"""

from __future__ import annotations

import contextlib
import io
import os
import stat
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.qos import QoS
from taskrpc.spi import install_command

try:
    from mcap import records
    from mcap.data_stream import ReadDataStream, RecordBuilder
    from mcap.opcode import Opcode
    from mcap.writer import MCAP0_MAGIC
except ModuleNotFoundError as error:
    if error.name and not error.name.startswith("mcap"):
        raise
    command = install_command("record", "mcap")
    raise TaskRpcError(f"recordings need mcap: {command}") from None

CDR = "cdr"
"""The encoding of ROS messages."""
JSON = "json"
"""The encoding of the task server's decisions."""
_SCHEMA = "ros2msg"
_QOS = "offered_qos_profiles"
_MESSAGE = struct.Struct("<BQHIQQ")
"""The head of a message: opcode, length, topic, number, and its time twice."""
_HEAD = struct.Struct("<BQ")
"""The head of each record: opcode, length."""
_MESSAGE_HEAD = struct.Struct("<HIQQ")
"""The head of a message after its opcode and length."""
_FOREVER = "{sec: 9223372036, nsec: 854775807}"
_RECORD_LIMIT = 2**30
"""Bytes of one record; a larger length is read only in a damaged file."""
_CHUNK_LIMIT = 2**28
"""Bytes of the contents of one chunk; rosbag2's chunks have about a megabyte."""
_EXPANSION, _FREE_EXPANSION = 256, 2**26
"""Bytes of the contents of all chunks for each byte of a file, and further bytes for every file: a
map without obstacles has sixteen megabytes, and a few kilobytes in a file."""
_FREE_RECORDS = 100_000
"""Records in the chunks of a file, besides one for each byte of the file."""
_TOPICS_LIMIT = 2**23
"""Bytes of the descriptions of all topics of a file; reading them takes longest."""
_QOS_LIMIT = 2**12
"""Characters of the text of a QoS; rosbag2 writes 400."""
_LONGEST_REASON = 240
"""Characters of an error about the contents of a file."""
LATEST = 2**63 - 1
"""Nanoseconds since 1970; a later time is read only in a damaged file."""


class RecordingError(TaskRpcError):
    """A file is not a recording, or it cannot be written."""


class Topic(msgspec.Struct, frozen=True):
    """A recorded topic."""

    name: str
    type_name: str
    """Such as `std_msgs/msg/String`; "" for JSON."""
    encoding: str
    """`CDR`, `JSON`, or another encoding of a foreign file."""
    schema_encoding: str = ""
    """`ros2msg` if `schema` can be read here."""
    schema: str = ""
    """The definition of the type; see `schemas`."""
    profile: str = ""
    """The QoS of its first publisher as text; see `first_profile`."""

    @property
    def qos(self) -> QoS:
        """The QoS of its first publisher."""
        return qos_from(self.profile)


class Message(msgspec.Struct, frozen=True):
    """A recorded message."""

    topic: Topic
    time: int
    """Nanoseconds since 1970, when the recorder got it."""
    data: bytes
    """The encoded message; CDR with its header."""


class RecordingWriter:
    """Writes a new recording.

    Raises:
        RecordingError: the file exists already, or cannot be created.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.messages = 0
        """How many messages were written."""
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._counts: list[int] = []
        """The messages of each channel."""
        self._span = 0, 0
        """The times of the first and the last message."""
        self._size = 0
        self._file = _created(self.path)
        self._is_open = True
        self._append(MCAP0_MAGIC + _encoded(records.Header("ros2", "taskrpc")))

    def add_topic(
        self, name: str, type_name: str, schema: str, *, type_hash: str = "", qos: QoS | None = None
    ) -> int:
        """Add a topic of CDR messages; returns the number for `write`."""
        metadata = {_QOS: qos_text(qos or QoS()), "topic_type_hash": type_hash}
        return self._add_channel(name, CDR, self._schema(type_name, schema), metadata)

    def add_json_topic(self, name: str) -> int:
        """Add a topic of JSON messages; returns the number for `write`."""
        # Without a schema: rosbags refuses a whole file that has a schema of an unknown language.
        return self._add_channel(name, JSON, 0, {})

    def write(self, topic: int, data: bytes, time: int) -> None:
        """Write a message; `time` in nanoseconds since 1970.

        Raises RecordingError if the disk refuses it, for example because it is full.
        """
        number = self.messages & 0xFFFFFFFF
        # The library's own writer takes three times as long; a server writes during its calls.
        self._append(
            _MESSAGE.pack(Opcode.MESSAGE, 22 + len(data), topic, number, time, time) + data
        )
        self.messages += 1
        self._counts[topic - 1] += 1
        first, last = self._span
        self._span = (min(first, time) if first else time), max(last, time)

    def close(self) -> None:
        """Write the summary and close the file. Raises RecordingError."""
        if not self._is_open:
            return
        try:
            self._append(_encoded(records.DataEnd(0)))
            self._append(self._summary())
        finally:
            self._is_open = False
            os.close(self._file)

    def discard(self) -> None:
        """Close the file and remove it; the writer has made it, so nothing else is lost."""
        if self._is_open:
            self._is_open = False
            os.close(self._file)
            with contextlib.suppress(OSError):
                self.path.unlink()

    def _summary(self) -> bytes:
        """Return the end of the file: the schemas and topics again, the counts, the footer."""
        begin, end = self._span
        statistics = records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(enumerate(self._counts, 1)),
            chunk_count=0,
            message_count=self.messages,
            message_start_time=begin,
            message_end_time=end,
            metadata_count=0,
            schema_count=len(self._schemas),
        )
        parts = [*self._schemas, *self._channels, statistics]
        footer = records.Footer(self._size, summary_offset_start=0, summary_crc=0)
        return b"".join(map(_encoded, [*parts, footer])) + MCAP0_MAGIC

    def _schema(self, type_name: str, text: str) -> int:
        data = text.encode()
        for schema in self._schemas:
            if (schema.name, schema.data) == (type_name, data):
                return schema.id
        schema = records.Schema(len(self._schemas) + 1, data, _SCHEMA, type_name)
        self._append(_encoded(schema))
        self._schemas.append(schema)
        return schema.id

    def _add_channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=metadata,
            schema_id=schema,
        )
        self._append(_encoded(channel))
        self._channels.append(channel)
        self._counts.append(0)
        return channel.id

    def _append(self, data: bytes) -> None:
        """Hand bytes to the operating system, without any buffer of this process."""
        try:
            written = os.write(self._file, data)
            while written < len(data):  # a disk that becomes full takes a part, then raises
                written += os.write(self._file, data[written:])
        except OSError as error:
            problem = f"cannot write {self.path}: {error.strerror or error}"
            raise RecordingError(problem) from None
        self._size += len(data)


def _created(path: Path) -> int:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    try:
        return os.open(path, flags | getattr(os, "O_CLOEXEC", 0), 0o644)
    except FileExistsError:
        problem = "the file exists already; choose another name or remove it"
        raise RecordingError(f"cannot record to {path}: {problem}") from None
    except OSError as error:
        raise RecordingError(f"cannot record to {path}: {error.strerror}") from None


def _encoded(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


class Recording:
    """A recording in MCAP that was written earlier; `messages` may be called several times.

    Args:
        path: the file, or the folder of a bag of rosbag2 with its .mcap files.

    Raises:
        RecordingError: it cannot be opened, or is not an MCAP file.
    """

    storage_id = "mcap"

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.problem = ""
        """What is missing, as a sentence; "" if the file is whole. Known after reading."""
        self.library = ""
        """The program that wrote it."""
        self.topics: dict[int, Topic] = {}
        """The topics found so far, by a number."""
        self._files = _files(self.path)
        for file in self._files:
            _check_magic(file)
        self.size = sum(file.stat().st_size for file in self._files)
        """Bytes."""

    def messages(self, *, keep: Callable[[Topic], bool] | None = None) -> Iterator[Message]:
        """Iterate over the messages in the order of the file, up to its end or its damage.

        `keep` chooses topics; the messages of the others are skipped.
        """
        self.problem = ""
        for number, file in enumerate(self._files):
            with file.open("rb") as stream:
                yield from self._read(stream, file, number << 16, keep)

    def _read(
        self, stream: BinaryIO, file: Path, offset: int, keep: Callable[[Topic], bool] | None
    ) -> Iterator[Message]:
        schemas: dict[int, tuple[records.Schema, str]] = {}
        kept: dict[int, Topic | None] = {}
        whole = 0  # bytes up to the end of the last whole record
        described = 0  # bytes of the descriptions of topics
        try:
            whole = stream.seek(len(MCAP0_MAGIC))
            for opcode, body in _records_of_file(stream, file.stat().st_size):
                if opcode == Opcode.MESSAGE:
                    channel_id, _, time, _ = _MESSAGE_HEAD.unpack_from(body)
                    if channel_id not in kept or time > LATEST:
                        raise ValueError("a message without a topic, or with an impossible time")
                    topic = kept[channel_id]
                    if topic is not None:
                        yield Message(topic, time, body[_MESSAGE_HEAD.size :])
                elif opcode == Opcode.SCHEMA:
                    schema = records.Schema.read(_fields(body))
                    # Decoded only once: many topics may have the same long schema.
                    schemas[schema.id] = schema, schema.data.decode(errors="replace")
                elif opcode == Opcode.CHANNEL:
                    if (channel_id := int.from_bytes(body[:2], "little")) not in kept:
                        described += len(body)
                        _check("descriptions of topics", described, _TOPICS_LIMIT)
                        channel = records.Channel.read(_fields(body))
                        topic = _topic(channel, schemas.get(channel.schema_id))
                        self.topics[offset + channel_id] = topic
                        kept[channel_id] = topic if keep is None or keep(topic) else None
                elif opcode == Opcode.HEADER:
                    self.library = self.library or records.Header.read(_fields(body)).library
                elif opcode == Opcode.DATA_END:
                    return
                whole = stream.tell()
            raise _IncompleteError
        except OSError as error:
            raise RecordingError(f"cannot read {file}: {error.strerror or error}") from None
        except Exception as error:  # for damaged bytes, the library raises what Python raises
            self.problem = self.problem or _problem(file, whole, error)


class _IncompleteError(Exception):
    """The file ends within a record, or before the record that ends the data."""


class _Body(io.BytesIO):
    """The bytes of one record."""

    def read(self, size: int | None = -1) -> bytes:
        """Return the next bytes. Raises ValueError if there are fewer."""
        data = super().read(size)
        if size is not None and len(data) < size:
            raise ValueError("a field is longer than its record")
        return data


def _fields(body: bytes) -> ReadDataStream:
    return ReadDataStream(_Body(body))


_IN_CHUNKS = (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)


def _records_of_file(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Iterate over the opcodes and contents of the records of a file, also of those in chunks.

    A short file can have chunks of gigabytes, or with millions of records: raises ValueError if
    they have far more than chunks of a file of `size` bytes need.
    """
    expanded, count = 0, 0
    for opcode, body in _records(stream, size):
        if opcode != Opcode.CHUNK:
            yield opcode, body
            continue
        chunk = records.Chunk.read(_fields(body))
        _check("a chunk", chunk.uncompressed_size, _CHUNK_LIMIT)
        expanded += chunk.uncompressed_size
        _check("chunks", expanded, _EXPANSION * size + _FREE_EXPANSION)
        for each in _records_of_chunk(chunk):
            count += 1
            if count > size + _FREE_RECORDS:
                raise ValueError(f"more than {count - 1:,} records in the chunks of a short file")
            if each[0] in _IN_CHUNKS:
                yield each


def _check(what: str, size: int, limit: int) -> None:
    if size > limit:
        raise ValueError(f"{what} of {size:,} bytes; expected at most {limit:,}")


def _records(stream: BinaryIO, end: int) -> Iterator[tuple[int, bytes]]:
    """Iterate over the opcodes and contents of records.

    Raises _IncompleteError if the last record is longer than the bytes up to `end`.
    """
    while (at := stream.tell()) < end:
        if end - at < _HEAD.size:
            raise _IncompleteError
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        _check("a record", length, _RECORD_LIMIT)
        if at + _HEAD.size + length > end:
            raise _IncompleteError
        yield opcode, stream.read(length)


def _records_of_chunk(chunk: records.Chunk) -> Iterator[tuple[int, bytes]]:
    size = chunk.uncompressed_size
    # A few bytes can expand to gigabytes: read only as many as the chunk says, and one more.
    data = _expanded(chunk, size + 1)
    if len(data) != size:
        raise ValueError("the contents of a chunk do not have the length that it says")
    try:
        yield from _records(io.BytesIO(data), size)
    except _IncompleteError:
        raise ValueError("a record is longer than its chunk") from None


def _expanded(chunk: records.Chunk, limit: int) -> bytes:
    """Return the contents of a chunk, but at most `limit` bytes."""
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as expanding:
            return expanding.read(limit)
    if chunk.compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=limit)
        return data
    if chunk.compression:
        raise ValueError(f"its compression {chunk.compression!a} is unknown")
    return chunk.data


def _problem(file: Path, whole: int, error: Exception) -> str:
    size = file.stat().st_size
    if isinstance(error, _IncompleteError):
        rest = f", its last {size - whole:,} bytes are an incomplete record" if size > whole else ""
        return (
            f"{file.name} is not finished: its recorder still runs, or was killed{rest};"
            " the messages before that are all there"
        )
    return (
        f"{file.name} is damaged after byte {whole:,} of {size:,} ({one_line(error)});"
        " the rest is missing"
    )


def one_line(error: BaseException) -> str:
    """Return what an error says about a file as one short line, without control characters."""
    words = " ".join(str(error).split()) or type(error).__name__
    clean = "".join(letter if letter.isprintable() else "?" for letter in words)
    return clean if len(clean) <= _LONGEST_REASON else clean[: _LONGEST_REASON - 1] + "…"


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    found = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    if not found:
        if any(path.glob("*.db3")):
            hint = "; its SQLite files are for `taskrpc bag`"
        elif any(each.suffix == ".zstd" for each in path.iterdir()):
            hint = "; taskrpc reads no compressed files"
        else:
            hint = ""
        raise RecordingError(f"expected a folder with .mcap files, {path} has none{hint}")
    return found


def _check_magic(file: Path) -> None:
    try:
        if not stat.S_ISREG(file.stat().st_mode):  # a pipe would wait for its writer
            raise RecordingError(f"cannot read {file}: expected a file, or a folder with files")
        with file.open("rb") as stream:
            found = stream.read(8)
    except OSError as error:
        raise RecordingError(f"cannot read {file}: {error.strerror}") from None
    if found == b"":
        raise RecordingError(f"{file} is empty; expected an MCAP file")
    if found != b"\x89MCAP0\r\n":
        hint = "; it is a bag of ROS 1" if found.startswith(b"#ROSBAG") else ""
        hint = "; it is an SQLite file" if found.startswith(b"SQLite") else hint
        raise RecordingError(f"{file} is not a recording: expected an MCAP file{hint}")


def _topic(channel: records.Channel, schema: tuple[records.Schema, str] | None) -> Topic:
    return Topic(
        channel.topic,
        schema[0].name if schema is not None else "",
        channel.message_encoding,
        schema[0].encoding if schema is not None else "",
        schema[1] if schema is not None else "",
        first_profile(channel.metadata.get(_QOS, "")),
    )


def qos_text(qos: QoS) -> str:
    """Return a QoS as rosbag2 stores it."""
    return (
        f"- history: keep_last\n  depth: {qos.depth}\n  reliability: {qos.reliability}\n"
        f"  durability: {qos.durability}\n  deadline: {_FOREVER}\n  lifespan: {_FOREVER}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration: {_FOREVER}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )


_RELIABILITY = {"1": "reliable", "2": "best_effort"}
_DURABILITY = {"1": "transient_local", "2": "volatile"}


def first_profile(text: str) -> str:
    """Return the first QoS in a text of rosbag2, which has one for each publisher."""
    second = text.find("\n- ", text.find("- ") + 1)
    return text if second < 0 else text[:second]


def qos_from(text: str) -> QoS:
    """Return the first QoS of a text of rosbag2, with the default for what it does not say."""
    import yaml

    profile = first_profile(text)
    if len(profile) > _QOS_LIMIT:
        return QoS()
    try:
        profiles: Any = yaml.safe_load(profile)
        first = profiles[0] if isinstance(profiles, list) and profiles else {}
        depth = first.get("depth", 10)
        reliability, durability = str(first.get("reliability")), str(first.get("durability"))
    except (yaml.YAMLError, AttributeError, ValueError, RecursionError):
        return QoS()  # ValueError: a date or a number that Python cannot read
    is_best_effort = _RELIABILITY.get(reliability, reliability) == "best_effort"
    is_latched = _DURABILITY.get(durability, durability) == "transient_local"
    return QoS(
        depth if type(depth) is int and 1 <= depth <= 10_000 else 10,
        "best_effort" if is_best_effort else "reliable",
        "transient_local" if is_latched else "volatile",
    )
