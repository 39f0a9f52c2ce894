"""A check that failed while the tab got its turn late runs a second time."""

import asyncio
import contextlib
import time

import pytest

from taskrpc.course.browser_lab.tab.delays import LONG, Delays


def test_only_long_delays_since_the_last_question_count():
    delays = Delays()
    assert not delays.were_long()
    delays.add(LONG)
    delays.add(LONG / 10)
    assert delays.were_long()
    assert not delays.were_long()


@pytest.mark.real_time
async def test_a_program_that_blocks_the_tab_is_noticed():
    delays = Delays()
    watching = asyncio.create_task(delays.watch())
    await asyncio.sleep(0)
    time.sleep(2 * LONG)
    await asyncio.sleep(LONG / 5)
    assert delays.were_long()
    watching.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await watching
