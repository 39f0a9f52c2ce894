"""The services of a node that show and set the levels of loggers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import srvgen

from . import logging
from ._impl.node_interface import NodeInterface

if TYPE_CHECKING:
    from srvgen.stubs.rcl_interfaces import srv


class LoggingService:
    """Gives a node `~/get_logger_levels` and `~/set_logger_levels`."""

    def __init__(self, node: NodeInterface) -> None:
        prefix = node.get_name()
        get_levels = srvgen.load("rcl_interfaces/srv/GetLoggerLevels")
        node.create_service(get_levels, f"{prefix}/get_logger_levels", self._get_logger_levels)
        set_levels = srvgen.load("rcl_interfaces/srv/SetLoggerLevels")
        node.create_service(set_levels, f"{prefix}/set_logger_levels", self._set_logger_levels)
        self._Level = srvgen.load("rcl_interfaces/msg/LoggerLevel")
        self._Result = srvgen.load("rcl_interfaces/msg/SetLoggerLevelsResult")

    def _get_logger_levels(
        self, request: srv.GetLoggerLevels.Request, response: srv.GetLoggerLevels.Response
    ) -> srv.GetLoggerLevels.Response:
        response.levels = [
            self._Level(name=name, level=int(logging.get_logger_level(name)))
            for name in request.names
        ]
        return response

    def _set_logger_levels(
        self, request: srv.SetLoggerLevels.Request, response: srv.SetLoggerLevels.Response
    ) -> srv.SetLoggerLevels.Response:
        response.results = [self._set(wanted) for wanted in request.levels]
        return response

    def _set(self, wanted: Any) -> Any:
        try:
            logging.set_logger_level(wanted.name, wanted.level)
        except ValueError:
            reason = "Failed reason: Invalid logger level."
            return self._Result(successful=False, reason=reason)
        return self._Result(successful=True)
