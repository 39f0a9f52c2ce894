"""Compressed lines come back as they were, from any time on, also as one gzip stream."""

from __future__ import annotations

import gzip
from unittest import mock

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.observe.recording import compressed_lines
from taskrpc.observe.recording.compressed_lines import CompressedLines

LINES = st.lists(st.tuples(st.integers(0, 9), st.binary(max_size=40).map(bytes.hex)), max_size=60)


def filled(rows):
    lines = CompressedLines()
    for time, text in rows:
        lines.add(time, text.encode())
    lines.flush()
    return lines


@given(LINES, st.integers(-1, 10))
def test_lines_come_back_from_any_time_on(rows, begin):
    rows.sort(key=lambda row: row[0])
    with mock.patch.object(compressed_lines, "_BLOCK", 100):
        lines = filled(rows)
    text = b"".join(lines.blocks())
    assert text == b"".join(text.encode() + b"\n" for _, text in rows)
    assert gzip.decompress(b"".join(lines.gzipped())) == text
    later = [text.encode() + b"\n" for time, text in rows if time >= begin]
    assert b"".join(lines.blocks(begin)).endswith(b"".join(later))


def test_blocks_are_small_in_memory():
    text = '{"t":1700000000.0,"event":"robot","data":{"x":1.0}}'
    lines = filled([(n, text) for n in range(50_000)])
    assert lines.compressed_size < 0.02 * 50_000 * len(text)
    assert len(list(lines.blocks())) > 10
    assert len(list(lines.blocks(49_999))) == 1
