"""Explains in one line that transforms3d is not installed."""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("transforms3d") is None:
    raise ModuleNotFoundError(
        "No module named 'transforms3d', which tf_transformations needs: pip install transforms3d",
        name="transforms3d",
    )
