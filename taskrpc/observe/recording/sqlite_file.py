"""Bags in SQLite, the format of ROS 2 before Iron; and the choice between them and MCAP."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

from taskrpc.observe.recording.mcap_file import (
    LATEST,
    Message,
    Recording,
    RecordingError,
    Topic,
    first_profile,
    one_line,
)

_MAGIC = b"SQLite format 3\0"
_METADATA = "metadata.yaml"
_CONVERT = "which taskrpc does not read; convert it with `ros2 bag convert` on a real ROS 2"
_TOPICS = "SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id"
_MESSAGES = (
    "SELECT topic_id, timestamp, data FROM messages"
    " WHERE topic_id IN ({ids}) ORDER BY timestamp, id"
)
_DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"


class SqliteRecording:
    """A bag in SQLite that was written earlier; it is read as a `Recording` is.

    Args:
        path: the .db3 file, or the folder of a bag of rosbag2 with its .db3 files.

    Raises:
        RecordingError: it cannot be opened, or is not an SQLite file.
    """

    storage_id = "sqlite3"
    library = ""
    """Nothing: the format does not name the program that wrote it."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.problem = ""
        """What is missing, as a sentence; "" if the file is whole. Known after reading."""
        self.topics: dict[int, Topic] = {}
        """The topics found so far, by a number."""
        self._files = _databases(self.path) if self.path.is_dir() else [self.path]
        try:
            self.size = sum(file.stat().st_size for file in self._files)
            """Bytes."""
        except OSError as error:
            raise RecordingError(f"cannot read {self.path}: {error.strerror}") from None

    def messages(self, *, keep: Callable[[Topic], bool] | None = None) -> Iterator[Message]:
        """Iterate over the messages of each file in the order of time.

        `keep` chooses topics; the messages of the others are skipped.
        """
        self.problem = ""
        for number, file in enumerate(self._files):
            try:
                uri = f"{file.resolve().as_uri()}?mode=ro"
                with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
                    yield from self._read(database, file, number << 16, keep)
            except sqlite3.Error as error:
                raise RecordingError(f"cannot read {file}: {one_line(error)}") from None

    def _read(
        self,
        database: sqlite3.Connection,
        file: Path,
        offset: int,
        keep: Callable[[Topic], bool] | None,
    ) -> Iterator[Message]:
        topics = _topics(database)
        self.topics |= {offset + number: topic for number, topic in topics.items()}
        kept = {number: each for number, each in topics.items() if keep is None or keep(each)}
        query = _MESSAGES.format(ids=", ".join(map(str, kept)))
        for number, time, data in database.execute(query):
            if not isinstance(data, bytes) or not isinstance(time, int) or not 0 <= time <= LATEST:
                self.problem = (
                    f"{file.name} is damaged: a message has no data or an impossible time"
                )
                return
            yield Message(kept[number], time, data)


AnyRecording: TypeAlias = Recording | SqliteRecording
"""A recording in any format that can be read."""


def open_recording(path: str | os.PathLike[str]) -> AnyRecording:
    """Open a file, or the folder of a bag, in the format that it has.

    Raises RecordingError if it cannot be opened, has no such format, or is compressed.
    """
    source = Path(path)
    if source.is_dir():
        _refuse_compression(source)
        return SqliteRecording(source) if _databases(source) else Recording(source)
    return SqliteRecording(source) if _is_sqlite(source) else Recording(source)


def _is_sqlite(file: Path) -> bool:
    if file.suffix == ".db3":
        return True
    if not file.is_file():  # a pipe would wait for its writer
        return False
    try:
        with file.open("rb") as stream:
            return stream.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False  # `Recording` says why


def _databases(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.db3"), key=lambda file: (len(file.name), file.name))


def _refuse_compression(folder: Path) -> None:
    """Raise RecordingError if a bag's metadata.yaml says that it is compressed."""
    import yaml

    described = folder / _METADATA
    if not described.is_file():
        return
    try:
        read: Any = yaml.safe_load(described.read_text(encoding="utf-8"))
        mode = str(read["rosbag2_bagfile_information"].get("compression_mode") or "").lower()
    except (OSError, ValueError, LookupError, TypeError, AttributeError, yaml.YAMLError):
        return  # the files say what they contain
    if mode not in ("", "none"):
        raise RecordingError(f"{folder} has compressed {mode}s, {_CONVERT}")


def _topics(database: sqlite3.Connection) -> dict[int, Topic]:
    """The topics of a file by their ids, with the definitions that newer files have."""
    definitions: dict[Any, tuple[str, str]] = {}
    if _columns(database, "message_definitions"):
        for type_name, encoding, text in database.execute(_DEFINITIONS):
            definitions[type_name] = str(encoding), str(text)
    has_qos = "offered_qos_profiles" in _columns(database, "topics")
    rows = database.execute(_TOPICS.format(qos="offered_qos_profiles" if has_qos else "''"))
    return {
        int(number): Topic(
            str(name),
            str(type_name),
            str(encoding),
            *definitions.get(type_name, ("", "")),
            profile=first_profile(str(profiles or "")),
        )
        for number, name, type_name, encoding, profiles in rows
    }


def _columns(database: sqlite3.Connection, table: str) -> list[str]:
    return [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
