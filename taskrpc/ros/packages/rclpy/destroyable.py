"""The type of handles, for annotations."""

from __future__ import annotations

from typing import Any, Protocol


class DestroyableType(Protocol):
    """The methods of every handle."""

    def __enter__(self) -> Any: ...

    def __exit__(self, *exc_info: object) -> None: ...

    def destroy_when_not_in_use(self) -> None:
        """Destroy it when no `with` block uses it any more."""
