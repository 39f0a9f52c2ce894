"""`taskrpc bag record`: records topics and the events of services until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import re
import sys
import time

from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import Exit, UsageError, tune_for_long_run
from taskrpc.cli.shared.remote import Remote, remote_of
from taskrpc.node import Node
from taskrpc.observe.recording.mcap_file import RecordingWriter
from taskrpc.observe.recording.recorder import Recorder, Selection
from taskrpc.program import stop_requested
from taskrpc.spi import SUFFIX

_POLL = 0.2
"""Seconds between two looks for new topics."""
_PATIENCE = 2.0
"""Seconds after which a named topic or service without a publisher is reported."""


def record(options: argparse.Namespace) -> Exit:
    """Record until Ctrl-C or SIGTERM."""
    selection = _selection(options)
    writer = RecordingWriter(options.output or time.strftime("rosbag2_%Y_%m_%d-%H_%M_%S.mcap"))
    try:
        asyncio.run(_record(remote_of(options), writer, selection, once=options.no_discovery))
    finally:
        writer.close()
    _say(f"recorded {writer.messages} messages in {writer.path}")
    return Exit.DONE


def _selection(options: argparse.Namespace) -> Selection:
    for option, pattern in ("--regex", options.regex), ("--exclude-regex", options.exclude_regex):
        try:
            re.compile(pattern)
        except re.error as error:
            problem = f"{option}: expected a regular expression, got {pattern!r}: {error}"
            raise UsageError(problem) from None
    named = [*options.topic_names, *options.topics]
    selection = Selection(
        topics=[quoting.expanded(name, kind="topic name") for name in named],
        services=[quoting.expanded(name) for name in options.services],
        all_topics=options.all or options.all_topics,
        all_services=options.all or options.all_services,
        pattern=options.regex,
        without=options.exclude_regex,
        hidden=options.include_hidden_topics,
    )
    if selection.is_empty:
        raise UsageError("expected topics to record, or --all, --services SERVICE, --regex REGEX")
    return selection


async def _record(
    remote: Remote, writer: RecordingWriter, selection: Selection, *, once: bool
) -> None:
    failure: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    async with stop_requested() as stopped, remote.node() as node:
        recorder = Recorder(node, writer, selection, failure.set_exception)
        search = asyncio.ensure_future(_search(remote, node, recorder, selection, once=once))
        _say(f"recording to {writer.path}; Ctrl-C ends it")
        tune_for_long_run()
        await asyncio.wait((stopped, failure, search), return_when=asyncio.FIRST_COMPLETED)
        search.cancel()
        await asyncio.wait((search,))
        recorder.close()
        if recorder.lost:
            _say(f"WARNING: {recorder.lost} messages were lost: the recorder was too slow")
    for each in (failure, search):
        if each.done() and not each.cancelled():
            each.result()  # raises the error that ended the recording


async def _search(
    remote: Remote, node: Node, recorder: Recorder, selection: Selection, *, once: bool
) -> None:
    """Subscribe to the selected topics as they appear."""
    loop = asyncio.get_running_loop()
    began, reported = loop.time(), False
    while True:
        for topic in recorder.update(await graph.entries_of(remote, node)):
            is_service = topic.endswith(SUFFIX)
            _say(f"recording {'the calls of ' * is_service}{topic.removesuffix(SUFFIX)}")
        if not reported and (once or loop.time() - began >= _PATIENCE):
            reported = True
            _report_missing(recorder, selection)
        if once:
            await loop.create_future()  # until the recording ends
        await asyncio.sleep(_POLL)


def _report_missing(recorder: Recorder, selection: Selection) -> None:
    found = set(recorder.topics)
    for name in selection.topics:
        if name not in found:
            _say(f"WARNING: no program publishes {name} yet")
    for name in selection.services:
        if name + SUFFIX not in found:
            _say(
                f"WARNING: no program publishes the calls of {name} yet; its server needs"
                " introspection: taskrpc-server --introspection contents, or"
                ' node.configure_introspection(service, "contents")'
            )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
