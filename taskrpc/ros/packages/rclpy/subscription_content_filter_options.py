"""The filter of a subscription by the content of messages."""

from __future__ import annotations

from typing import NamedTuple


class ContentFilterOptions(NamedTuple):
    """An expression such as `data > %0`, and its parameters as texts.

    See `Subscription.set_content_filter`.
    """

    filter_expression: str
    expression_parameters: list[str]
