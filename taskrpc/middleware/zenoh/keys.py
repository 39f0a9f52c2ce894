"""The key expressions of rmw_zenoh, and those of taskrpc's own programs. Pure.

| key                                      | what it carries                                    |
|------------------------------------------|----------------------------------------------------|
| `DOMAIN/NAME/TYPE/HASH`                  | the requests of a service, the messages of a topic |
| `@ros2_lv/DOMAIN/…`                      | the graph of ROS 2; see `tokens`                   |
| `taskrpc/DOMAIN/alive/ID`                | a liveliness token for each taskrpc program        |
| `taskrpc/DOMAIN/entry/ID`                | what the program offers                            |
| `taskrpc/DOMAIN/inbox/ID`                | datagrams for the program                          |

`NAME` is the absolute name without its first slash. `ID` is the id of the program's session.
"""

from __future__ import annotations

import re

_DDS_TYPE = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_")
_TYPE = re.compile(r"(\w+)/(\w+)/(\w+)")
_ADDRESS = re.compile(r"[0-9a-f]{1,32}")


def data_key(domain: int, name: str, type_name: str, type_hash: str) -> str:
    """Return the key of a service's requests or of a topic's messages."""
    return f"{domain}/{name.strip('/')}/{dds_type(type_name)}/{type_hash}"


def dds_type(type_name: str) -> str:
    """Return a type as keys name it: `std_srvs::srv::dds_::Trigger_`."""
    found = _TYPE.fullmatch(type_name)
    return f"{found[1]}::{found[2]}::dds_::{found[3]}_" if found else type_name.replace("/", "::")


def ros_type(dds_name: str) -> str:
    """Return a type as ROS names it: `std_srvs/srv/Trigger`; an unknown form stays as it is."""
    found = _DDS_TYPE.fullmatch(dds_name)
    return f"{found[1]}/{found[2]}/{found[3]}" if found else dds_name


def mangle(name: str) -> str:
    """Return a name as one part of a token: `/` becomes `%`."""
    return name.replace("/", "%") or "%"


def demangle(part: str) -> str:
    """Return the name that `mangle` turned into this part of a token."""
    return part.replace("%", "/")


def alive_key(domain: int, address: str = "*") -> str:
    """Return the key of a taskrpc program's liveliness token, by default of all programs."""
    return f"taskrpc/{domain}/alive/{address}"


def entry_key(domain: int, address: str = "*") -> str:
    """Return the key of what a taskrpc program offers, by default of all programs."""
    return f"taskrpc/{domain}/entry/{address}"


def inbox_key(domain: int, address: str) -> str:
    """Return the key of a taskrpc program's datagrams."""
    return f"taskrpc/{domain}/inbox/{address}"


def address_of(key: str) -> str:
    """Return the address in the key of a taskrpc program, "" for garbage."""
    address = key.rpartition("/")[2]
    return address if is_address(address) else ""


def is_address(text: str) -> bool:
    """Whether a text can be the id of a session. A wildcard would reach all programs."""
    return _ADDRESS.fullmatch(text) is not None
