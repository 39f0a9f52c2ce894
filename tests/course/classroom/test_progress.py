"""How far a student is, from what the server knows."""

import pytest

from taskrpc.course.classroom.progress import GONE_AFTER, STUCK_AFTER, Progress, Signs, progress


@pytest.mark.parametrize(
    ("signs", "shown"),
    [
        (Signs(), Progress.AWAY),
        (Signs(True, 1000.0), Progress.NEW),
        (Signs(False, 1000.0, 1000.0), Progress.NEW),
        (Signs(True, 1000.0 - STUCK_AFTER), Progress.STUCK),
        (Signs(True, 1000.0 - 99 * STUCK_AFTER), Progress.STUCK),
        (Signs(False, 1000.0 - STUCK_AFTER, 1000.0), Progress.STUCK),
        (Signs(False, 0.0, 1000.0 - GONE_AFTER), Progress.AWAY),
        (Signs(False, 0.0, 1001.0 - GONE_AFTER), Progress.STUCK),
        (Signs(True, 0.0, 1000.0 - GONE_AFTER, 1), Progress.WORKING),
        (Signs(False, 0.0, 1001.0 - GONE_AFTER, 1), Progress.WORKING),
        (Signs(False, 0.0, 1000.0 - GONE_AFTER, 1), Progress.AWAY),
    ],
)
def test_progress_follows_from_connection_time_and_successful_calls(signs, shown):
    assert progress(signs, 1000.0) is shown
