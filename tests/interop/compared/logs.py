"""Loggers: levels, children, filters, and wrong calls. The lines go to stdout for comparison."""

import os

os.environ["RCUTILS_CONSOLE_OUTPUT_FORMAT"] = "[{severity}] [{name}]: {message}"
os.environ["RCUTILS_LOGGING_USE_STDOUT"] = "1"
os.environ["RCUTILS_LOGGING_BUFFERED_STREAM"] = "1"
os.environ["RCUTILS_COLORIZED_OUTPUT"] = "0"

import rclpy
from rclpy.logging import LoggingSeverity, get_logger, get_logging_severity_from_string
from shared import attempt, end, fails

rclpy.init()
node = rclpy.create_node("logs", namespace="arm")
log = node.get_logger()
attempt("name", lambda: log.name)
attempt("level", lambda: log.get_effective_level().name)
attempt("debug", lambda: log.debug("a"))
attempt("info", lambda: log.info("a"))
attempt("warning", lambda: log.warning("a"))
attempt("warn", lambda: log.warn("a"))
attempt("error", lambda: log.error("a"))
attempt("fatal", lambda: log.fatal("a"))
for level in ("info", "error"):
    attempt(f"{level} from one line", lambda level=level: getattr(log, level)("a"))
log.set_level(LoggingSeverity.DEBUG)
attempt("debug", lambda: log.debug("now"))
child = log.get_child("hand")
attempt("child", lambda: (child.name, child.get_effective_level().name))
child.set_level(LoggingSeverity.ERROR)
attempt("quiet", lambda: (child.info("no"), child.is_enabled_for(LoggingSeverity.WARN)))
attempt("loud", lambda: child.error("yes"))
for _ in range(3):
    attempt("once", lambda: log.info("once", once=True))
for _ in range(3):
    attempt("skip first", lambda: log.info("skip", skip_first=True))
for _ in range(3):
    attempt("throttle", lambda: log.info("throttled", throttle_duration_sec=100))
fails("number", lambda: log.info(5))
fails("none", lambda: log.info(None))
attempt("two arguments", lambda: log.info("a %s", "b"))
attempt("unknown option", lambda: log.info("a", unknown=True))
attempt("wrong throttle", lambda: log.info("a", throttle_duration_sec="a"))
attempt("set a number", lambda: log.set_level(30))
attempt("set a text", lambda: log.set_level("x"))
attempt("level", lambda: log.get_effective_level().name)
attempt("level of a text", lambda: get_logging_severity_from_string("WARN").name)
fails("level of another text", lambda: get_logging_severity_from_string("LOUD"))
attempt("log", lambda: log.log("by level", LoggingSeverity.ERROR))
attempt("logger", lambda: get_logger("").name)
attempt("empty child", lambda: get_logger("").get_child("a").name)
attempt(
    "levels",
    lambda: [
        each
        for each in ("DEBUG", "INFO", "WARN", "ERROR", "FATAL", "UNSET")
        if hasattr(LoggingSeverity, each)
    ],
)
attempt("unset", lambda: (log.set_level(LoggingSeverity.UNSET), log.get_effective_level().name))
end()
