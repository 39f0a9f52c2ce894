"""Counts and times of a program's calls, and of its tasks, for Prometheus."""

from taskrpc.metrics.collector import Metrics
from taskrpc.metrics.families import Family, Histogram, Kind, Sample
from taskrpc.metrics.prometheus import CONTENT_TYPE, render
from taskrpc.metrics.stores import store_families

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
