"""Writes and reads bags, the recordings of ROS 2, with the classes of the package `rosbag2_py`.

`writer` and `reader` have the classes that programs use, `storage` the descriptions that both take
and the file metadata.yaml. The format MCAP itself is in `taskrpc.observe.recording.mcap_file`. Only
programs import this package.
"""

from typing import NoReturn

from taskrpc.errors import TaskRpcError

try:
    from .reader import Info, SequentialReader
    from .storage import (
        BagMetadata,
        ConverterOptions,
        FileInformation,
        StorageFilter,
        StorageOptions,
        TopicInformation,
        TopicMetadata,
        get_default_storage_id,
    )
    from .writer import SequentialWriter
except TaskRpcError as error:  # the extra `record` is not installed
    raise ModuleNotFoundError(f"rosbag2_py: {error}", name="mcap") from None

__all__ = [
    "BagMetadata",
    "ConverterOptions",
    "FileInformation",
    "Info",
    "SequentialReader",
    "SequentialWriter",
    "StorageFilter",
    "StorageOptions",
    "TopicInformation",
    "TopicMetadata",
    "get_default_storage_id",
]

_RECORD = "record with the command `taskrpc bag record`, or write with SequentialWriter"
_PLAY = "play a bag with the command `taskrpc bag play`, or watch it with `taskrpc view`"
_COMPRESS = "it reads and writes bags without zstd compression: use SequentialReader or -Writer"
_REAL = "run the program on a real ROS 2"

_MISSING = {
    **dict.fromkeys(("Recorder", "RecordOptions"), _RECORD),
    **dict.fromkeys(("Player", "PlayOptions", "ServiceRequestsSource"), _PLAY),
    **dict.fromkeys(("SequentialCompressionReader", "SequentialCompressionWriter"), _COMPRESS),
    **dict.fromkeys(
        "CompressionMode CompressionOptions bag_rewrite MessageDefinition MetadataIo ReadOrder"
        " ReadOrderSortBy Reindexer get_registered_compressors get_registered_readers"
        " get_registered_serializers get_registered_writers".split(),
        _REAL,
    ),
}
"""Names of ROS's package that are not here, each with the advice for its users."""


def __getattr__(name: str) -> NoReturn:
    if advice := _MISSING.get(name):
        raise ImportError(f"taskrpc's rosbag2_py does not have {name}: {advice}", name=__name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
