"""The program that is running, where several share one interpreter."""

from __future__ import annotations

from contextvars import ContextVar

current_program: ContextVar[str] = ContextVar("current_program", default="")
"""The name of the running program where several share one interpreter, as in a browser tab; else
"". What a process has once, such as its endpoint or rclpy's default context, each of them has."""
