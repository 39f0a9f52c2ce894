"""All frames as text: the YAML of the service `tf2_frames`, and a graph for graphviz.

Both have exactly the format of tf2.
"""

from __future__ import annotations

from .frame_tree import FrameTree
from .time_cache import FrameCache, shown

_SHORTEST = 100_000
"""The shortest history, in nanoseconds, that the rate of a frame is computed from."""


def as_yaml(tree: FrameTree) -> str:
    """Each frame with its parent, its sender, its rate and its times."""
    if not tree.names():
        return "[]"
    return "".join(
        f"{name}: \n"
        f"  parent: '{parent}'\n"
        f"  broadcaster: '{authority}'\n"
        f"  rate: {_rate(cache):.3f}\n"
        f"  most_recent_transform: {shown(cache.latest_time)}\n"
        f"  oldest_transform: {shown(cache.oldest_time)}\n"
        f"  buffer_length: {_length(cache):.3f}\n"
        for name, parent, cache, authority in tree.frames()
        if parent
    )


def as_dot(tree: FrameTree, now: int = 0) -> str:
    """A graph of the frames, for graphviz.

    Args:
        now: the present time, for the age of the transforms; 0 leaves it out.
    """
    lines = ["digraph G {"]
    if not tree.names():
        lines.append('"no tf data recieved"')
    parents = {name: parent for name, parent, _, _ in tree.frames()}
    for name, parent, cache, authority in tree.frames():
        if parent:
            age = f"( {(now - cache.latest_time) / 1e9:.3f} sec old)" if now else ""
            lines.append(
                f'"{parent}" -> "{name}"[label="Broadcaster: {authority}\\n'
                f"Average rate: {_rate(cache):.3f} Hz\\n"
                f"Most recent transform: {shown(cache.latest_time)} {age}\\n"
                f'Buffer length: {_length(cache):.3f} sec\\n"];'
            )
    for name in tree.names():
        if not parents.get(name) and (now or name in parents):
            recorded = f'"Recorded at time: {shown(now)}"[ shape=plaintext ] ;\n ' if now else ""
            lines.append("edge [style=invis];")
            lines.append(
                " subgraph cluster_legend { style=bold; color=black;"
                f' label ="view_frames Result";\n{recorded}}}->"{name}";'
            )
    return "\n".join(lines) + "\n}"


def _length(cache: FrameCache) -> float:
    return (cache.latest_time - cache.oldest_time) / 1e9


def _rate(cache: FrameCache) -> float:
    return len(cache) * 1e9 / max(cache.latest_time - cache.oldest_time, _SHORTEST)
