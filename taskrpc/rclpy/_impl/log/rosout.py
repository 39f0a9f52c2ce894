"""Publishes what a node's loggers log on `/rosout`."""

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
"""Where the log of all nodes is."""

_Log = srvgen.load("rcl_interfaces/msg/Log")
_Time = srvgen.load("builtin_interfaces/msg/Time")


class Rosout:
    """Takes what is logged under a node's name or its children's; the last of it is kept."""

    def __init__(self, node: NodeHandle, name: str, qos_profile: QoSProfile | int) -> None:
        qos = qos_profile if isinstance(qos_profile, QoSProfile) else QoSProfile(depth=qos_profile)
        self._name = name
        # Not one of the node's own publishers, as in ROS; nor does it keep the node alive.
        self._native = node.bridge.publisher(_Log, TOPIC, qos.to_native())
        remember_profile(self, EndpointTypeEnum.PUBLISHER, node.full_name, TOPIC, qos)
        output.add_rosout(name, self.publish)

    def publish(self, record: Record) -> None:
        """Publish a line of the log, unless no message can hold it or the program has ended."""
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
        """Publish no more."""
        output.remove_rosout(self._name)
        self._native.close()
        forget_profile(self)
