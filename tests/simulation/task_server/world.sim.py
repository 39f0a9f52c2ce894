"""Two servers, three callers and an operator, and all that can go wrong between them.

`taskrpc simulate world.sim.py --seed 42 --runs 1` tells the story of a seed that fails. A test
names a folder in WORLD: the file `bug` there says what to plant, and each run adds its counts, one
line of JSON, to `counts`.
"""

import json
import os
import sys
from pathlib import Path

from ledger import verdict
from moments import CALM, DURATION, LEASE
from promises import PROMISES

from taskrpc.core.exactly_once import deduplicator
from taskrpc.core.request_ids.ledger import Ledger
from taskrpc.simulation import Scenario

Ledger.__init__.__kwdefaults__["lease"] = LEASE
deduplicator._EXPIRE_EVERY = 1.0

scenario = Scenario(DURATION)
scenario.program("main", "server.py", "main")
scenario.program("helper", "server.py", "helper")
for n in range(3):
    scenario.program(f"client{n}", "client.py", f"client{n}", f"user{n}.secret-of-the-user{n}")
scenario.program("operator", "operators.py")
scenario.faults(
    delay=(0.0, 0.03),
    cut=0.3,
    partition=(0.5, 4.0),
    wrong_clock=("main",),
    crash=("main", "helper", "client0", "client1", "client2"),
    restart=(0.01, 1.5),
    until=CALM,
)

if "WORLD" in os.environ:
    folder = Path(os.environ["WORLD"])
    sys.path.append(str(Path(__file__).parents[3]))
    from tests.simulation.task_server.planting import HAPPENED, plant

    plant((folder / "bug").read_text())

    @scenario.finally_
    def told(world):
        """Tell the test what happened."""
        counts = verdict(world).counts + HAPPENED
        HAPPENED.clear()
        with open(folder / "counts", "a") as file:
            file.write(json.dumps(counts) + "\n")


def kept(promise):
    def check(world):
        wrong = verdict(world).broken[promise]
        assert not wrong, f"{promise}: {'; '.join(wrong)}"

    check.__name__ = promise.replace(" ", "_")
    return check


for each in PROMISES:
    scenario.finally_(kept(each))
