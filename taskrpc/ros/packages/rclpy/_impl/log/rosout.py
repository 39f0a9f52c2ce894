"""Publishes the log of a node on `/rosout`."""

from __future__ import annotations

import contextlib

import srvgen
from taskrpc.errors import TaskRpcError

from ...endpoint_info import EndpointTypeEnum
from ...qos import QoSProfile
from ..graph.endpoints import forget_profile, remember_profile
from ..node_interface import NodeHandle
from . import output
from .format import Record

TOPIC = "/rosout"
"""The topic of the log of all nodes."""

_Log = srvgen.load("rcl_interfaces/msg/Log")
_Time = srvgen.load("builtin_interfaces/msg/Time")


class Rosout:
    """Publishes the lines of the logger of a node and of its child loggers."""

    def __init__(self, node: NodeHandle, name: str, qos_profile: QoSProfile | int) -> None:
        qos = qos_profile if isinstance(qos_profile, QoSProfile) else QoSProfile(depth=qos_profile)
        self._name = name
        # As in ROS, `Node.publishers` does not list it. It does not keep the node alive.
        self._native = node.bridge.publisher(_Log, TOPIC, qos.to_native())
        remember_profile(self, EndpointTypeEnum.PUBLISHER, node.full_name, TOPIC, qos)
        output.add_rosout(name, self.publish)

    def publish(self, record: Record) -> None:
        """Publish a line of the log; do nothing if a message cannot hold it or the program ends."""
        seconds, nanoseconds = divmod(record.nanoseconds, 10**9)
        line = _Log(
            stamp=_Time(sec=seconds, nanosec=nanoseconds),
            level=int(record.severity),
            name=record.name,
            msg=record.message,
            file=record.file,
            function=record.function,
            line=record.line,
        )
        with contextlib.suppress(TaskRpcError):
            self._native.publish(line)

    def destroy(self) -> None:
        """Stop publishing."""
        output.remove_rosout(self._name)
        self._native.close()
        forget_profile(self)
