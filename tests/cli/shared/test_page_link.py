"""The links of a live page are noted for this user only, and only while the server runs."""

import asyncio
import os
import shutil
import stat
import sys

import pytest

from taskrpc.cli.shared.page_link import CHECK, NotedLink, PageLink, noted_links
from taskrpc.core.transport.discovery.registry import Registry, domain_folder

LINK = PageLink(7, "http://127.0.0.1:1", "VIEW", "CONTROL")


def files():
    return sorted(domain_folder(0).path.glob("web-*"))


def test_noted_links_are_found_until_they_are_removed():
    assert noted_links() == []
    noted = NotedLink(LINK)
    assert noted_links() == [LINK]
    noted.close()
    assert noted_links() == []
    assert files() == []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_only_the_user_can_read_the_file():
    noted = NotedLink(LINK)
    [path] = files()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    noted.close()


def test_file_of_a_killed_server_is_ignored_and_replaced():
    killed = NotedLink(LINK)
    os.close(killed._descriptor)
    assert noted_links() == []
    noted = NotedLink(LINK)
    assert noted_links() == [LINK]
    noted.close()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no open files")
@pytest.mark.parametrize("remove", [shutil.rmtree, lambda folder: files()[0].unlink()])
async def test_removed_file_is_written_again(remove):
    noted = NotedLink(LINK)
    keeping = asyncio.create_task(noted.keep())
    for _ in range(2):
        remove(domain_folder(0).path)
        assert noted_links() == []
        await asyncio.sleep(CHECK + 0.1)
        assert noted_links() == [LINK]
    keeping.cancel()
    noted.close()
    assert files() == []


def test_newest_server_is_first():
    noted = [NotedLink(PageLink(pid, "http://127.0.0.1:1", "", "")) for pid in (1, 2)]
    for pid, path in zip((1, 2), files(), strict=True):
        os.utime(path, (pid, pid))
    assert [link.pid for link in noted_links()] == [2, 1]
    for each in noted:
        each.close()


def test_unreadable_contents_are_ignored():
    noted = NotedLink(LINK)
    os.ftruncate(noted._descriptor, 3)
    assert noted_links() == []
    noted.close()


def test_registry_does_not_take_the_file_for_an_entry():
    noted = NotedLink(LINK)
    assert Registry(0).entries() == []
    assert noted_links() == [LINK]
    noted.close()


def test_tokens_are_not_shown_by_repr():
    assert "CONTROL" not in repr(LINK)
    assert "VIEW" not in repr(LINK)


@pytest.mark.parametrize(
    ("url", "is_local"),
    [
        ("http://127.0.0.1:1", True),
        ("https://127.0.0.1:1", True),
        ("http://[::1]:1", True),
        ("https://192.0.2.7:1", False),
        ("https://0.0.0.0:1", False),
    ],
)
def test_page_of_this_machine_needs_no_token_to_look(url, is_local):
    link = PageLink(1, url, "VIEW", "CONTROL")
    assert link.is_local is is_local
    assert link.view_link == (f"{url}/" if is_local else f"{url}/#view=VIEW")
