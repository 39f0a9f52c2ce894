"""A kernel of Jupyter whose cells a test runs, as a frontend would."""

from __future__ import annotations

import os
import queue
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jupyter_client import KernelManager
from jupyter_client.kernelspec import KernelSpec

_LONGEST = 60.0
"""Seconds that a cell may take on a busy machine."""


@dataclass
class Output:
    """What a cell has shown so far."""

    text: str = ""
    error: str = ""
    pictures: list[dict[str, str]] = field(default_factory=list)
    """The MIME bundles of `display`, each with its later updates."""
    updates: int = 0


class Kernel:
    """A kernel in a folder of its own; close it."""

    def __init__(self, folder: Path, runtime: Path, **environment: str) -> None:
        self._manager = KernelManager()
        # The kernel of this Python, whichever are installed on the machine.
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        self._manager._kernel_spec = KernelSpec(argv=command, language="python")
        own = {"XDG_RUNTIME_DIR": str(runtime), **environment}
        self._manager.start_kernel(cwd=str(folder), env={**os.environ, **own})
        self._connect()

    def _connect(self) -> None:
        self._client = self._manager.client()
        self._client.start_channels()
        self._client.wait_for_ready(_LONGEST)

    def run(self, code: str, cell: str = "", interrupt_at: str = "") -> Output:
        """Run a cell. Once it has printed `interrupt_at`, interrupt it."""
        content = {"code": code, "silent": False, "store_history": True, "allow_stdin": False}
        content |= {"user_expressions": {}, "stop_on_error": True}
        metadata = {"cellId": cell} if cell else {}
        message = self._client.session.msg("execute_request", content, metadata=metadata)
        self._client.shell_channel.send(message)
        output, end = Output(), time.monotonic() + _LONGEST
        while time.monotonic() < end:
            if interrupt_at and interrupt_at in output.text:
                interrupt_at = ""
                time.sleep(1.0)  # the cell goes on from its `print` to its wait
                self._manager.interrupt_kernel()
            try:
                received = self._client.get_iopub_msg(timeout=0.1)
            except queue.Empty:
                continue
            kind, shown = received["msg_type"], received["content"]
            if kind == "stream":
                output.text += shown["text"]
            elif kind == "error":
                output.error += "\n".join(shown["traceback"])
            elif kind == "display_data":
                output.pictures.append(shown["data"])
            elif kind == "update_display_data":
                output.pictures[-1:] = [shown["data"]]
                output.updates += 1
            elif shown.get("execution_state") == "idle" and _is_answer(received, message):
                return output
        raise AssertionError(f"the cell did not end: {code}\n{output}")

    def good(self, code: str, cell: str = "") -> str:
        """Run a cell that must not fail; returns what it has printed."""
        output = self.run(code, cell)
        assert not output.error, output.error
        return output.text

    def restart(self) -> None:
        """Restart the kernel, as the button does."""
        self._client.stop_channels()
        self._manager.restart_kernel(now=True)
        self._connect()

    def close(self) -> None:
        """End the kernel."""
        self._client.stop_channels()
        self._manager.shutdown_kernel(now=True)


def _is_answer(received: dict[str, Any], request: dict[str, Any]) -> bool:
    return bool(received["parent_header"].get("msg_id") == request["header"]["msg_id"])
