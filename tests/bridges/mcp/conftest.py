"""The pure modules need nothing; the tests of the protocol need the extra `mcp`."""

from importlib.metadata import PackageNotFoundError, version


def _major() -> int:
    try:
        return int(version("mcp").partition(".")[0])
    except PackageNotFoundError:
        return 0


collect_ignore = [] if _major() >= 2 else ["test_server.py", "test_serving.py"]
