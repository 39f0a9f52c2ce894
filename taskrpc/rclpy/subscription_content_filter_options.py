"""Filters by content, which only some middlewares of ROS support; taskrpc does not."""

from __future__ import annotations

from typing import NamedTuple


class ContentFilterOptions(NamedTuple):
    """An expression such as `data > %0`, and its parameters."""

    filter_expression: str
    expression_parameters: list[str]
