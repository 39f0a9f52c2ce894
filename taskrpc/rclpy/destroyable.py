"""The shape of what can be destroyed while others may still use it."""

from __future__ import annotations

from typing import Any, Protocol


class DestroyableType(Protocol):
    """What every handle can do, for type hints."""

    def __enter__(self) -> Any: ...

    def __exit__(self, *exc_info: object) -> None: ...

    def destroy_when_not_in_use(self) -> None:
        """End it as soon as nobody is inside of `with`."""
