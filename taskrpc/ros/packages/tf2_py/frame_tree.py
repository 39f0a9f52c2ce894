"""A tree of frames: stores transforms, and computes the transform between any two frames.

Times are nanoseconds; 0 means the latest time that is known for all frames between the two.
Exceptions and refusals have the texts of tf2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from .exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from .geometry import Transform, normalized
from .time_cache import LATEST, Entry, FrameCache, StaticCache, TimeCache, shown

DEFAULT_CACHE_TIME = 10_000_000_000
"""How long a frame's transforms are kept: 10 s."""

_MOST_PARENTS = 1000
"""A chain with more parents than this is a loop."""


class FrameTree:
    """Frames, each with its parent and the history of its transform to this parent.

    Args:
        cache_time: how long transforms are kept, in nanoseconds before the newest one.
    """

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        self._cache_time = cache_time
        self._caches: dict[str, FrameCache | None] = {}
        """The history of each known frame, in the order in which the frames became known.

        None for a frame that is only known as a parent.
        """
        self._authorities: dict[str, str] = {}

    def set(
        self,
        parent: str,
        child: str,
        time: int,
        transform: Transform,
        authority: str,
        *,
        is_static: bool = False,
    ) -> list[str]:
        """Store a transform from a frame to its parent.

        As in tf2, a leading slash of a name is dropped, and a quaternion of another length than 1
        is normalised.

        Returns:
            The reasons why the transform was refused; empty if it was taken.
        """
        parent, child = parent.removeprefix("/"), child.removeprefix("/")
        if refused := list(_refusals(parent, child, transform, authority)):
            return refused
        cache = self._caches.get(child)
        if cache is None or isinstance(cache, StaticCache) != is_static:
            cache = StaticCache() if is_static else TimeCache(self._cache_time)
            self._caches[child] = cache
        self._caches.setdefault(parent, None)
        taken = transform._replace(rotation=normalized(transform.rotation))
        if not cache.insert(Entry(time, parent, taken)):
            return [
                f"TF_OLD_DATA ignoring data from the past for frame {child} at time {shown(time)}"
                f" according to authority {authority}\nPossible reasons are listed at"
                " http://wiki.ros.org/tf/Errors%20explained"
            ]
        self._authorities[child] = authority
        return []

    def clear(self) -> None:
        """Forget all transforms that are not static; the names of the frames stay known."""
        for cache in self._caches.values():
            if cache is not None:
                cache.clear()

    # Lookups

    def lookup(self, target: str, source: str, time: int) -> tuple[Transform, int]:
        """The transform that converts coordinates from `source` to `target`.

        Returns:
            The transform, and its time: the given one or, for time 0, the latest common one.

        Raises:
            LookupException: a frame does not exist.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the time is outside the history of a frame between the two.
            InvalidArgumentException: a name is empty or begins with a slash.
        """
        if target == source:
            cache = self._caches.get(target)
            return Transform(), cache.latest_time if time == LATEST and cache else time
        self._validate("lookupTransform argument target_frame", target)
        self._validate("lookupTransform argument source_frame", source)
        up, down, time = self._way(target, source, time)
        found = _combined(down).inverse().after(_combined(up)) if down else _combined(up)
        return found._replace(rotation=normalized(found.rotation)), time

    def lookup_full(
        self, target: str, target_time: int, source: str, source_time: int, fixed: str
    ) -> tuple[Transform, int]:
        """The transform from a frame at one time to a frame at another time.

        `fixed` is a frame that does not move between the two times. Raises as `lookup`.
        """
        for kind, name in (("target", target), ("source", source), ("fixed", fixed)):
            self._validate(f"lookupTransform argument {kind}_frame", name)
        first, _ = self.lookup(fixed, source, source_time)
        second, time = self.lookup(target, fixed, target_time)
        found = second.after(first)
        return found._replace(rotation=normalized(found.rotation)), time

    def obstacle(self, target: str, source: str, time: int) -> str:
        """Why `lookup` would fail; "" if it would not."""
        if target == source:
            return ""
        return (
            self._unknown("target", target)
            or self._unknown("source", source)
            or self._obstacle_on_way(target, source, time)
        )

    def obstacle_full(
        self, target: str, target_time: int, source: str, source_time: int, fixed: str
    ) -> str:
        """Why `lookup_full` would fail; "" if it would not."""
        return (
            self._unknown("target", target)
            or self._unknown("source", source)
            or self._unknown("fixed", fixed)
            or self._obstacle_on_way(target, fixed, target_time)
            or self._obstacle_on_way(fixed, source, source_time)
        )

    def latest_common_time(self, target: str, source: str) -> int:
        """The latest time for which all frames between the two have a transform.

        It is 0 if all of these are static. Raises LookupException, ConnectivityException.
        """
        self._validate("get_latest_common_time", target)
        self._validate("get_latest_common_time", source)
        return self._latest_common_time(target, source)

    def chain(
        self, target: str, target_time: int, source: str, source_time: int, fixed: str
    ) -> list[str]:
        """The names of the frames on the way from `source` to `target`. Raises as `lookup`."""
        before = self._names_between(fixed, source, source_time)
        after = self._names_between(target, fixed, target_time)
        return before + after[1:]

    # The known frames

    def knows(self, name: str) -> bool:
        """Whether the frame exists."""
        return name in self._caches

    def names(self) -> list[str]:
        """All frames, in the order in which they became known."""
        return list(self._caches)

    def frames(self) -> Iterator[tuple[str, str, FrameCache, str]]:
        """Each frame with its newest parent, its history and who sent it.

        The parent is "" if the history was cleared. Frames without a parent are left out.
        """
        for name, cache in self._caches.items():
            if cache is not None:
                newest = cache.newest()
                authority = self._authorities.get(name, "no recorded authority")
                yield name, newest.parent if newest else "", cache, authority

    def as_string(self) -> str:
        """One sentence for each frame that has had a parent."""
        return "".join(
            f"Frame {name} exists with parent {parent or 'NO_PARENT'}.\n"
            for name, parent, _, _ in self.frames()
        )

    # The chain of frames between two frames

    def _way(self, target: str, source: str, time: int) -> tuple[list[Entry], list[Entry], int]:
        """Return the entries from `source` and from `target` up to a common frame, and the time."""
        if time == LATEST:
            time = self._latest_common_time(target, source)
        up: list[Entry] = []
        above_source = {source: 0}
        """How many steps up from `source` each of its ancestors is."""
        problem = ""
        try:
            for entry in self._entries_above(source, time):
                up.append(entry)
                above_source[entry.parent] = len(up)
                if entry.parent == target:
                    return up, [], time
        except ExtrapolationException as error:  # the target may still be below the last frame
            problem = f"{error}{_when(source, target)}"
        down: list[Entry] = []
        try:
            for entry in self._entries_above(target, time):
                down.append(entry)
                if (steps := above_source.get(entry.parent)) is not None:
                    return up[:steps], down, time
        except ExtrapolationException as error:
            raise ExtrapolationException(f"{error}{_when(source, target)}") from None
        if problem:
            raise ExtrapolationException(problem)
        raise self._unconnected(target, source)

    def _entries_above(self, name: str, time: int) -> Iterator[Entry]:
        """The entries at a time, from a frame up to the root. Raises ExtrapolationException."""
        for _ in range(_MOST_PARENTS + 1):
            cache = self._caches.get(name)
            if cache is None:
                return
            entry = cache.at(time)
            yield entry
            name = entry.parent
        raise self._loop()

    def _latest_common_time(self, target: str, source: str) -> int:
        if source == target:
            cache = self._caches.get(source)
            return cache.latest_time if cache else 0
        times: list[int] = []
        above_source = {source: 0}
        """How many steps up from `source` each of its ancestors is."""
        for entry in self._newest_above(source):
            times.append(entry.time)
            above_source[entry.parent] = len(times)
            if entry.parent == target:
                return _earliest(times)
        below_target: list[int] = []
        if target not in above_source:
            for entry in self._newest_above(target):
                below_target.append(entry.time)
                if entry.parent in above_source:
                    return _earliest(times[: above_source[entry.parent]] + below_target)
        raise self._unconnected(target, source)

    def _newest_above(self, name: str) -> Iterator[Entry]:
        """The newest transforms from a frame up to the root."""
        for _ in range(_MOST_PARENTS + 1):
            cache = self._caches.get(name)
            newest = cache.newest() if cache is not None else None
            if newest is None:
                return
            yield newest
            name = newest.parent
        raise self._loop()

    def _names_between(self, target: str, source: str, time: int) -> list[str]:
        if target == source:
            return [source]
        self._validate("lookupTransform argument target_frame", target)
        self._validate("lookupTransform argument source_frame", source)
        up, down, time = self._way(target, source, time)
        rising = [source, *(entry.parent for entry in up)]
        falling = [target, *(entry.parent for entry in down)]
        return rising + falling[-2::-1]

    # Errors

    def _validate(self, where: str, name: str) -> None:
        _check_name(name)
        if not name or name.startswith("/"):
            why = "cannot start with a '/'" if name else "cannot be empty"
            raise InvalidArgumentException(
                f'Invalid argument "{name}" passed to {where} - in tf2 frame_ids {why}'
            )
        if name not in self._caches:
            raise LookupException(f'"{name}" passed to {where} does not exist. ')

    def _unknown(self, kind: str, name: str) -> str:
        """As `_validate`, in the words that tf2 uses for canTransform."""
        _check_name(name)
        if not name:
            why = "in tf2 frame_ids cannot be empty"
        elif name.startswith("/"):
            why = "in tf2 frame_ids cannot start with a '/'"
        elif name not in self._caches:
            why = "frame does not exist"
        else:
            return ""
        return f'Invalid frame ID "{name}" passed to canTransform argument {kind}_frame - {why}'

    def _obstacle_on_way(self, target: str, source: str, time: int) -> str:
        try:
            if target != source:
                self._way(target, source, time)
        except TransformException as error:
            return str(error)
        return ""

    def _unconnected(self, target: str, source: str) -> ConnectivityException:
        return ConnectivityException(
            f"Could not find a connection between '{target}' and '{source}' because they are not"
            " part of the same tree.Tf has two or more unconnected trees."
        )

    def _loop(self) -> LookupException:
        return LookupException(
            f"The tf tree is invalid because it contains a loop.\n{self.as_string()}\n"
        )


def _check_name(name: object) -> None:
    if not isinstance(name, str):
        raise TypeError(f"expected the name of a frame (str), got {type(name).__name__} {name!r}")


def _refusals(parent: str, child: str, transform: Transform, authority: str) -> Iterator[str]:
    numbers = (
        "({:f} {:f} {:f})".format(*transform.translation),
        "({:f} {:f} {:f} {:f})".format(*transform.rotation),
    )
    if child == parent:
        yield (
            f'TF_SELF_TRANSFORM: Ignoring transform from authority "{authority}" with frame_id and'
            f'  child_frame_id "{child}" because they are the same'
        )
    if not child:
        yield (
            f'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "{authority}" because'
            " child_frame_id not set "
        )
    if not parent:
        yield (
            f'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "{child}"  from authority'
            f' "{authority}" because frame_id not set'
        )
    if any(map(math.isnan, (*transform.translation, *transform.rotation))):
        yield (
            f'TF_NAN_INPUT: Ignoring transform for child_frame_id "{child}" from authority'
            f' "{authority}" because of a nan value in the transform {" ".join(numbers)}'
        )
    elif math.isnan(normalized(transform.rotation)[0]):
        yield (
            f'TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id "{child}" from'
            f' authority "{authority}" because of an invalid quaternion in the transform'
            f" {numbers[1]}"
        )


def _when(source: str, target: str) -> str:
    return f", when looking up transform from frame [{source}] to frame [{target}]"


def _combined(way: list[Entry]) -> Transform:
    """The transform from the first frame of a chain to its last parent."""
    whole = Transform()
    for entry in way:
        whole = entry.transform.after(whole)
    return whole


def _earliest(times: list[int]) -> int:
    """The earliest time; times of static transforms (0) do not count."""
    return min((time for time in times if time), default=0)
