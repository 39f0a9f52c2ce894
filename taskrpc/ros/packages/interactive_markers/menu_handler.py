"""MenuHandler: a context menu of markers, with callbacks for its entries."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from visualization_msgs.msg import InteractiveMarkerFeedback, MenuEntry


@dataclass
class _Entry:
    title: str
    command: str
    command_type: int
    callback: Callable[[Any], object] | None
    check_state: int = 0
    visible: bool = True
    children: list[int] = field(default_factory=list)


class MenuHandler:
    """The entries of a menu by their handles; `apply` shows them at a marker."""

    NO_CHECKBOX = 0
    CHECKED = 1
    UNCHECKED = 2

    def __init__(self) -> None:
        self._entries: dict[int, _Entry] = {}
        self._top: list[int] = []
        self._markers: set[str] = set()

    def insert(
        self,
        title: str,
        parent: int | None = None,
        command_type: int = MenuEntry.FEEDBACK,
        command: str = "",
        callback: Callable[[Any], object] | None = None,
    ) -> int | None:
        """Add an entry, below another one or at the top; return its handle.

        Returns None, and prints why, if there is no such parent.
        """
        if parent is not None and parent not in self._entries:
            print(f"Parent menu entry {parent} not found.", file=sys.stderr)
            return None
        handle = len(self._entries) + 1
        self._entries[handle] = _Entry(title, command, command_type, callback)
        (self._top if parent is None else self._entries[parent].children).append(handle)
        return handle

    def setVisible(self, handle: int, visible: bool) -> bool:
        """Show or hide an entry; False if there is none."""
        if handle in self._entries:
            self._entries[handle].visible = visible
        return handle in self._entries

    def setCheckState(self, handle: int, check_state: int) -> bool:
        """Set whether an entry is checked, or has no check box; False if there is none."""
        if handle in self._entries:
            self._entries[handle].check_state = check_state
        return handle in self._entries

    def getCheckState(self, handle: int) -> int | None:
        """Whether an entry is checked; None if there is none."""
        entry = self._entries.get(handle)
        return None if entry is None else entry.check_state

    def getTitle(self, handle: int) -> str | None:
        """The title of an entry; None if there is none."""
        entry = self._entries.get(handle)
        return None if entry is None else entry.title

    def apply(self, server: Any, marker_name: str) -> bool:
        """Give a marker this menu; False if there is none. `server.applyChanges` sends it."""
        marker = server.get(marker_name)
        if marker is None:
            self._markers.discard(marker_name)
            return False
        marker.menu_entries = list(self._shown(self._top, 0))
        server.insert(
            marker,
            feedback_callback=self.processFeedback,
            feedback_type=InteractiveMarkerFeedback.MENU_SELECT,
        )
        self._markers.add(marker_name)
        return True

    def reApply(self, server: Any) -> bool:
        """Give all markers that have this menu its new state; False if one is gone."""
        done = [self.apply(server, name) for name in sorted(self._markers)]
        return all(done)

    def processFeedback(self, feedback: Any) -> None:
        """Call the callback of the entry that a user has selected."""
        entry = self._entries.get(feedback.menu_entry_id)
        if entry is not None and entry.callback is not None:
            entry.callback(feedback)

    def _shown(self, handles: list[int], parent: int) -> Iterator[Any]:
        """Yield the messages of entries and of those below them."""
        boxes = {self.CHECKED: "[x] ", self.UNCHECKED: "[ ] "}
        for handle in handles:
            entry = self._entries[handle]
            if entry.visible:
                yield MenuEntry(
                    id=handle,
                    parent_id=parent,
                    title=boxes.get(entry.check_state, "") + entry.title,
                    command=entry.command,
                    command_type=entry.command_type,
                )
                yield from self._shown(entry.children, handle)
