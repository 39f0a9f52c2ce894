"""The pure modules need nothing; the tests of the protocol need the extra `mcp`."""

from importlib.metadata import PackageNotFoundError, version


def _major() -> int:
    try:
        return int(version("mcp").partition(".")[0])
    except PackageNotFoundError:
        return 0


NEEDS_MCP = ["test_calls.py", "test_server.py", "test_serving.py", "test_topics.py"]
collect_ignore = [] if _major() >= 2 else NEEDS_MCP
