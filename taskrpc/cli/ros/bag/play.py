"""`taskrpc bag play`: publishes the messages of a recording again."""

from __future__ import annotations

import argparse
import asyncio
import sys

from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import Exit, NotFound
from taskrpc.cli.shared.remote import remote_of
from taskrpc.observe.recording.player import Player, PlaySettings
from taskrpc.observe.recording.sqlite_file import AnyRecording, open_recording
from taskrpc.observe.texts import printable

_LAST = 0.1
"""Seconds to stay after the last message, so that it is sent."""


def play(options: argparse.Namespace) -> Exit:
    """Play a recording to its end."""
    recording = open_recording(options.file)
    asyncio.run(_play(options, recording))
    return Exit.DONE


def _settings(options: argparse.Namespace) -> PlaySettings:
    return PlaySettings(
        rate=options.rate,
        start_offset=options.start_offset,
        duration=options.playback_duration,
        topics=_names(options.topics, options.services),
        exclude=_names(options.exclude_topics, options.exclude_services),
        publish_requests=options.publish_service_requests,
        delay=options.delay,
    )


def _names(topics: list[str], services: list[str]) -> list[str]:
    absolute = [quoting.expanded(name, kind="topic name") for name in topics]
    return [*absolute, *(quoting.expanded(name) for name in services)]


async def _play(options: argparse.Namespace, recording: AnyRecording) -> None:
    async with remote_of(options).node() as node:
        player = Player(node, recording, _settings(options))
        while True:
            before = player.published
            await player.play()
            if not options.loop or player.published == before:
                break
        await asyncio.sleep(_LAST)
    for topic, reason in player.skipped.items():
        print(f"WARNING: {printable(topic)} was not played: {reason}", file=sys.stderr)
    if recording.problem:
        print(f"WARNING: {recording.problem}", file=sys.stderr)
    if not player.published:
        raise NotFound(f"{options.file}: no message was played; taskrpc bag info lists the topics")
    print(f"played {player.published} messages", file=sys.stderr)
