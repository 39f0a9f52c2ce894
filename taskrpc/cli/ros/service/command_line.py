"""`taskrpc service`: call, echo, find, info, list and type, as in `ros2 service`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping

from taskrpc.cli import call
from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import Commands, add_command, add_group, print_names

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from taskrpc.spi import RegistryEntry, ServiceEndpoint


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about services."""
    what = "Consider hidden services as well"
    parser.add_argument("--include-hidden-services", action="store_true", help=what)
    commands = add_group(parser)
    call.configure(add_command(commands, "call", "Call a service"))
    _add_echo(commands)
    _add_find(commands)
    _add_info(commands)
    _add_list(commands)
    _add_type(commands)


def _add_echo(commands: Commands) -> None:
    from taskrpc.cli.shared.parsing import add_lengths
    from taskrpc.cli.shared.remote import add_connect, add_discovery

    parser = add_command(commands, "echo", "Print the steps of the calls of a service")
    parser.add_argument("service_name", help="Name of the service (e.g. '/add_two_ints')")
    what = "Type of the service (e.g. 'example_interfaces/srv/AddTwoInts')"
    parser.add_argument("service_type", nargs="?", default="", help=what)
    what = "Output all values separated by commas (e.g. for plotting)"
    parser.add_argument("--csv", action="store_true", help=what)
    add_lengths(parser, flow_style="Output each array in one line")
    add_connect(parser)
    add_discovery(parser)
    parser.set_defaults(run=_echo)


def _add_find(commands: Commands) -> None:
    parser = add_command(commands, "find", "Output a list of available services of a given type")
    what = "Name of the service type to filter for (e.g. 'example_interfaces/srv/AddTwoInts')"
    parser.add_argument("service_type", help=what)
    _add_list_options(parser)
    parser.set_defaults(run=_find)


def _add_info(commands: Commands) -> None:
    parser = _add_with_name(commands, "info", "Print information about a service")
    what = "Print each server and client"
    parser.add_argument("-v", "--verbose", action="store_true", help=what)
    parser.set_defaults(run=_info)


def _add_list(commands: Commands) -> None:
    parser = add_command(commands, "list", "Output a list of available services")
    what = "Additionally show the service type"
    parser.add_argument("-t", "--show-types", action="store_true", help=what)
    _add_list_options(parser)
    parser.set_defaults(run=_list)


def _add_type(commands: Commands) -> None:
    _add_with_name(commands, "type", "Output a service's type").set_defaults(run=_type)


def _add_with_name(commands: Commands, name: str, purpose: str) -> argparse.ArgumentParser:
    parser = add_command(commands, name, purpose)
    parser.add_argument("service_name", help="Name of the service (e.g. '/add_two_ints')")
    _add_common(parser)
    return parser


def _add_list_options(parser: argparse.ArgumentParser) -> None:
    what = "Only display the number of services discovered"
    parser.add_argument("-c", "--count-services", "--count", action="store_true", help=what)
    # No default here: it would overwrite the option of the same name before the subcommand.
    parser.add_argument(
        "--include-hidden-services",
        action="store_true",
        default=argparse.SUPPRESS,
        help="Consider hidden services as well",
    )
    _add_common(parser)


def _add_common(parser: argparse.ArgumentParser) -> None:
    from taskrpc.cli.shared.remote import add_connect, add_discovery

    add_connect(parser)
    add_discovery(parser)
    parser.add_argument("--json", action="store_true", help="Print JSON")


def _echo(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.service import echo

    return echo.echo(options)


def _list(options: argparse.Namespace) -> int:
    from taskrpc.spi import suggestions

    found = suggestions.services(_look(options), hidden=options.include_hidden_services)
    if options.count_services:
        print(len(found))
    elif options.json:
        import json

        print(json.dumps([{"name": name, "types": types} for name, types in found.items()]))
    else:
        for name, types in found.items():
            print(f"{name} [{', '.join(types)}]" if options.show_types else name)
    return Exit.DONE


def _find(options: argparse.Namespace) -> int:
    from taskrpc.cli.shared.definitions import service_type_name
    from taskrpc.spi import suggestions

    wanted = service_type_name(options.service_type)
    found = suggestions.services(_look(options), hidden=options.include_hidden_services)
    matching = [name for name, types in found.items() if wanted in types]
    return print_names(matching, count=options.count_services, as_json=options.json)


def _type(options: argparse.Namespace) -> int:
    from taskrpc.spi import suggestions

    name, entries = quoting.expanded(options.service_name), _look(options)
    types = suggestions.services(entries, hidden=True).get(name)
    if types is None:
        raise _unknown(options, name, entries)
    return print_names(types, as_json=options.json)


def _info(options: argparse.Namespace) -> int:
    name, entries = quoting.expanded(options.service_name), _look(options)
    servers = [_facts("SERVER", one, entry) for entry in entries for one in entry.services]
    clients = [_facts("CLIENT", one, entry) for entry in entries for one in entry.clients]
    found = [facts for facts in servers + clients if facts.pop("Service name") == name]
    if not found:
        raise _unknown(options, name, entries)
    types = sorted({str(facts["Service type"]) for facts in found})
    endpoints = {
        "Clients count": [each for each in found if each["Endpoint type"] == "CLIENT"],
        "Services count": [each for each in found if each["Endpoint type"] == "SERVER"],
    }
    if options.json:
        import json

        counts = {label: len(group) for label, group in endpoints.items()}
        print(json.dumps({"Type": ", ".join(types), **counts, "Endpoints": found}))
        return Exit.DONE
    print(f"Type: {types[0] if len(types) == 1 else types}")
    for label, group in endpoints.items():
        print(f"{label}: {len(group)}")
        if options.verbose:
            print()
            for facts in group:
                _print_facts(facts)
                print()
    return Exit.DONE


def _facts(kind: str, endpoint: ServiceEndpoint, entry: RegistryEntry) -> dict[str, str | int]:
    """Return the facts about a server or client of a service, by the labels to print."""
    from taskrpc.cli.shared import graph

    namespace, _, node = endpoint.node.rpartition("/")
    return {
        "Service name": endpoint.name,
        "Node name": node,
        "Node namespace": namespace or "/",
        "Service type": endpoint.type_name,
        "Service type hash": endpoint.type_hash,
        "Endpoint type": kind,
        "Endpoint count": 1,
        "GID": graph.gid(entry, endpoint, {"CLIENT": 3, "SERVER": 4}[kind]),
        "Process": f"{entry.script} (pid {entry.pid}, in {entry.folder})" if entry.pid else "",
        "Address": entry.address,
    }


def _print_facts(facts: Mapping[str, object]) -> None:
    for label, value in facts.items():
        if value != "":
            print(f"{label}: {value}")
    from taskrpc.cli.shared import graph

    print("\n".join(graph.qos_lines()))


def _look(options: argparse.Namespace) -> list[RegistryEntry]:
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import remote_of

    return graph.look(remote_of(options))


def _unknown(options: argparse.Namespace, name: str, entries: Iterable[RegistryEntry]) -> NotFound:
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import remote_of

    hint = graph.unknown_service_hint(name, entries, remote_of(options))
    return hinted(NotFound(f"Unknown service '{name}'"), hint)
