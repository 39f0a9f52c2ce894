"""Definitions of services from texts of other types, and the message of a refused one."""

from __future__ import annotations

import pytest

import srvgen
from srvgen.definitions.lines import join_full_text
from srvgen.errors import DefinitionError
from srvgen.files.search import BUNDLED, Search

bundled = Search([BUNDLED])
EVENT = ("service_msgs/msg/ServiceEventInfo", "builtin_interfaces/msg/Time")


def define(own: str, name: str = "far_msgs/srv/Ask", **needed: str):
    texts = {one: bundled.text(one) for one in EVENT}
    texts |= {f"far_msgs/msg/{one}": text for one, text in needed.items()}
    return srvgen.define(name, join_full_text(own, texts))


def refused(text: str, **needed: str) -> str:
    with pytest.raises(DefinitionError) as caught:
        define(text, **needed)
    return caught.value.message
