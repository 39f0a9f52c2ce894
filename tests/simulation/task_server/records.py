"""The records that the programs print; the ledger reads them at the end of a run."""

import asyncio
import json


def now():
    """The virtual time in seconds; all programs have the same."""
    return asyncio.get_running_loop().time()


def record(what, *values):
    """Print what happened."""
    print(json.dumps([now(), what, *values]))


def fails(number, kind):
    """Whether the handler of a call raises an exception."""
    return number % 9 == 4 and kind not in ("submit", "nowhere")
