"""Offers a service of our own type, my_interfaces/srv/CheckScan."""

import math
from pathlib import Path
from typing import Any

import srvgen
from taskrpc import sync

# From here on Python finds my_interfaces/srv/CheckScan.srv beside this script and imports it.
srvgen.install_import_hook(Path(__file__).parent)
from my_interfaces.srv import CheckScan

NAMES = {
    CheckScan.Response.GO: "GO",
    CheckScan.Response.SLOW: "SLOW",
    CheckScan.Response.STOP: "STOP",
}


def check(request: Any, response: Any) -> Any:
    seen = [distance for distance in request.ranges if distance <= request.max_range]
    response.seen = len(seen)
    response.nearest = min(seen, default=math.inf)
    if response.nearest < 0.5:
        response.advice = response.STOP
    elif response.nearest < 1.0:
        response.advice = response.SLOW
    print(f"nearest of {len(request.ranges)}: {response.nearest} m, {NAMES[response.advice]}")
    return response  # advice is 0, which is GO, where we set nothing


def main() -> None:
    with sync.Node("scan_checker") as node:
        node.create_service(CheckScan, "check_scan", check)
        print("/check_scan is ready; Ctrl-C ends it")
        node.spin()


if __name__ == "__main__":
    main()
