"""How fast messages are made, encoded and decoded, beside rosbags and pycdr2.

    pip install rosbags pycdr2        # each is left out where it is missing
    python benchmarks/srvgen_codecs.py [--rounds 15] [--json results.json]

Four messages, from two integers to a path of a hundred poses. All contenders take turns in every
round, and each cell is the least of the rounds, in nanoseconds; the last column is the quotient of
our CDR and rosbags in the same run, which is what may be compared between machines. Encoding
includes our check of every field, decoding to msgpack too (CDR is checked while it is read). The
720 ranges of the scan are handed to each constructor as what its own decoder makes: our array,
numpy's array, pycdr2's list.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import msgspec

import srvgen
from srvgen import _runtime

STEPS = ("construct", "encode", "decode")
TYPES = {
    # rosbags knows messages only; what matters is the fields
    "AddTwoInts": "example_interfaces/msg/AddTwoInts_Request",
    "PoseStamped": "geometry_msgs/msg/PoseStamped",
    "LaserScan": "sensor_msgs/msg/LaserScan",
    "Path": "nav_msgs/msg/Path",
}
POSES, RANGES = 100, 720
CHUNK = 0.004
"""Seconds for which one cell runs in one round."""


@dataclass
class Contender:
    """How one library handles a message: three functions for each of the types."""

    name: str
    makers: dict[str, Callable[[], Any]]
    encoder: Callable[[str, Any], Callable[[], Any]]
    """A message of one of the types → what is called to encode it."""
    decoder: Callable[[str, Any], Callable[[], Any]]
    """Data of one of the types → what is called to decode them."""
    times: dict[tuple[str, str], list[float]] = field(default_factory=dict)

    def steps(self, message: str) -> Iterator[tuple[str, Callable[[], Any]]]:
        make = self.makers[message]
        encode = self.encoder(message, make())
        yield "construct", make
        yield "encode", encode
        yield "decode", self.decoder(message, encode())


def makers(classes: dict[str, Any], floats: Callable[[list[float]], Any]) -> dict[str, Any]:
    """The four constructors, each of which makes all nested messages anew."""
    header, time_, pose, point, quaternion = (
        classes[name] for name in ("Header", "Time", "Pose", "Point", "Quaternion")
    )
    pose_stamped, path = classes["PoseStamped"], classes["Path"]
    ranges, none = floats([index / 100 for index in range(RANGES)]), floats([])

    def make_header() -> Any:
        return header(stamp=time_(sec=1_700_000_000, nanosec=123_456_789), frame_id="map")

    def make_pose() -> Any:
        return pose_stamped(
            header=make_header(),
            pose=pose(
                position=point(x=1.5, y=-2.25, z=0.125),
                orientation=quaternion(x=0.0, y=0.0, z=0.6, w=0.8),
            ),
        )

    def make_scan() -> Any:
        return classes["LaserScan"](
            header=make_header(),
            angle_min=-1.5,
            angle_max=1.5,
            angle_increment=0.25,
            time_increment=0.0,
            scan_time=0.125,
            range_min=0.25,
            range_max=10.0,
            ranges=ranges,
            intensities=none,
        )

    return {
        "AddTwoInts": lambda: classes["AddTwoInts"](a=2, b=3),
        "PoseStamped": make_pose,
        "LaserScan": make_scan,
        "Path": lambda: path(header=make_header(), poses=[make_pose() for _ in range(POSES)]),
    }


def our_classes() -> dict[str, Any]:
    load = srvgen.load
    return {
        "AddTwoInts": load("example_interfaces/srv/AddTwoInts").Request,
        **{name: load(TYPES[name]) for name in ("PoseStamped", "LaserScan", "Path")},
        **{name: load(f"geometry_msgs/msg/{name}") for name in ("Pose", "Point", "Quaternion")},
        "Header": load("std_msgs/msg/Header"),
        "Time": load("builtin_interfaces/msg/Time"),
    }


def taskrpc_cdr() -> Contender:
    classes = our_classes()
    return Contender(
        "taskrpc CDR",
        makers(classes, _runtime.Float32Array),
        lambda name, message: partial(srvgen.to_cdr, message),
        lambda name, data: partial(srvgen.from_cdr, classes[name], data),
    )


def taskrpc_msgpack() -> Contender:
    classes = our_classes()
    encoder = msgspec.msgpack.Encoder(enc_hook=_runtime.encode_hook).encode
    decoders = {name: msgspec.msgpack.Decoder(classes[name]).decode for name in TYPES}

    def encode(message: Any) -> bytes:
        message._check()
        return encoder(message)

    def decode(decoder: Callable[[bytes], Any], data: bytes) -> Any:
        message = decoder(data)
        message._check()
        return message

    return Contender(
        "taskrpc msgpack",
        makers(classes, _runtime.Float32Array),
        lambda name, message: partial(encode, message),
        lambda name, data: partial(decode, decoders[name], data),
    )


def rosbags() -> Contender:
    import numpy as np
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("int64 a\nint64 b\n", TYPES["AddTwoInts"]))
    classes = {name: store.types[full] for name, full in TYPES.items()}
    for name in ("Pose", "Point", "Quaternion"):
        classes[name] = store.types[f"geometry_msgs/msg/{name}"]
    classes["Header"] = store.types["std_msgs/msg/Header"]
    classes["Time"] = store.types["builtin_interfaces/msg/Time"]
    return Contender(
        "rosbags",
        makers(classes, lambda values: np.array(values, np.float32)),
        lambda name, message: partial(store.serialize_cdr, message, TYPES[name]),
        lambda name, data: partial(store.deserialize_cdr, data, TYPES[name]),
    )


def pycdr2() -> Contender:
    from pycdr2 import IdlStruct
    from pycdr2.types import float32, float64, int32, int64, sequence, uint32

    def struct(name: str, **fields: Any) -> Any:
        return dataclass(type(IdlStruct)(name, (IdlStruct,), {"__annotations__": fields}))

    time_ = struct("Time", sec=int32, nanosec=uint32)
    header = struct("Header", stamp=time_, frame_id=str)
    point = struct("Point", x=float64, y=float64, z=float64)
    quaternion = struct("Quaternion", x=float64, y=float64, z=float64, w=float64)
    pose = struct("Pose", position=point, orientation=quaternion)
    pose_stamped = struct("PoseStamped", header=header, pose=pose)
    singles = "angle_min angle_max angle_increment time_increment scan_time range_min range_max"
    classes = {
        "Time": time_,
        "Header": header,
        "Point": point,
        "Quaternion": quaternion,
        "Pose": pose,
        "PoseStamped": pose_stamped,
        "AddTwoInts": struct("AddTwoInts_Request", a=int64, b=int64),
        "Path": struct("Path", header=header, poses=sequence[pose_stamped]),
        "LaserScan": struct(
            "LaserScan",
            header=header,
            **dict.fromkeys(singles.split(), float32),
            ranges=sequence[float32],
            intensities=sequence[float32],
        ),
    }
    return Contender(
        "pycdr2",
        makers(classes, list),
        lambda name, message: message.serialize,
        lambda name, data: partial(classes[name].deserialize, data),
    )


def contenders() -> Iterator[Contender]:
    for make in (taskrpc_cdr, taskrpc_msgpack, rosbags, pycdr2):
        try:
            yield make()
        except ImportError as error:
            print(f"left out: {make.__name__} ({error})", file=sys.stderr)


def refuse_differences(all_: list[Contender]) -> None:
    """Speed means nothing where the bytes differ."""
    ours = all_[0]
    for other in all_:
        if other.name != "taskrpc msgpack":
            for message in TYPES:
                data = bytes(other.encoder(message, other.makers[message]())())
                if data != ours.encoder(message, ours.makers[message]())():
                    raise SystemExit(f"{other.name} writes another {message} than we do")


def timed(function: Callable[[], Any], count: int) -> float:
    """Nanoseconds a call."""
    calls = range(count)
    begin = time.perf_counter_ns()
    for _ in calls:
        function()
    return (time.perf_counter_ns() - begin) / count


def run(all_: list[Contender], rounds: int) -> None:
    cells = [
        (contender, message, step, function)
        for message in TYPES
        for contender in all_
        for step, function in contender.steps(message)
    ]
    counts = [max(1, round(CHUNK * 1e9 / timed(cell[3], 20))) for cell in cells]
    for _ in range(rounds):
        for (contender, message, step, function), count in zip(cells, counts, strict=True):
            contender.times.setdefault((message, step), []).append(timed(function, count))


def table(all_: list[Contender]) -> list[list[str]]:
    known = {contender.name: contender for contender in all_}
    rows = [["message", "step", *known, "CDR / rosbags"]]
    for message in TYPES:
        for step in STEPS:
            times = {name: min(one.times[message, step]) for name, one in known.items()}
            ratio = times["taskrpc CDR"] / times["rosbags"] if "rosbags" in times else None
            last = f"{ratio:.2f}" if ratio is not None else "-"
            rows.append([message, step, *(f"{ns:,.0f}" for ns in times.values()), last])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--json", type=Path, help="write the numbers there, too")
    options = parser.parse_args()
    all_ = list(contenders())
    refuse_differences(all_)
    run(all_, options.rounds)
    rows = table(all_)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))
    if options.json:
        least = {
            one.name: {f"{m} {s}": min(ns) for (m, s), ns in one.times.items()} for one in all_
        }
        options.json.write_text(json.dumps(least, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
