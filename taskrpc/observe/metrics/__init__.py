"""Metrics for Prometheus: counts and durations of a program's calls, messages and tasks.

Start reading with `collector`, the observer that counts calls; `tasks` measures a task server.
`prometheus` has the values and their text format. Nothing here serves HTTP; `web` beside it does.
"""

from taskrpc.observe.metrics.collector import Metrics, store_families
from taskrpc.observe.metrics.prometheus import CONTENT_TYPE, Family, Histogram, Kind, Sample, render

__all__ = [
    "CONTENT_TYPE",
    "Family",
    "Histogram",
    "Kind",
    "Metrics",
    "Sample",
    "render",
    "store_families",
]
