"""`taskrpc door`: checks a policy, and explains what browsers and agents may do by it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import add_command, add_group

if TYPE_CHECKING:
    from taskrpc.bridges.door.policy import Policy


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the commands for policies to a parser."""
    commands = add_group(parser)
    check = add_command(commands, "check", "Check a policy, and explain what each name may do")
    check.add_argument("file", metavar="FILE", help="The policy (YAML)")
    what = "Also refuse names of services and topics that no program of this machine has now"
    check.add_argument("--running", action="store_true", help=what)
    check.set_defaults(run=_check)
    explain = add_command(commands, "explain", "Explain what a name may do, or decide one request")
    add = explain.add_argument
    add("file", metavar="FILE", help="The policy (YAML)")
    add("name", metavar="NAME", nargs="?", help="A name of the policy (default: all)")
    what = "A service or topic that the name would use"
    add("service_name", metavar="TARGET", nargs="?", help=what)
    what = 'The request or message in YAML, with all fields that have limits (e.g. "{priority: 3}")'
    add("message", metavar="VALUES", nargs="?", help=what)
    what = "What the name would do with it (default: call)"
    add("--verb", choices=("call", "publish", "read"), default="call", help=what)
    explain.set_defaults(run=_explain)


def _check(options: argparse.Namespace) -> int:
    from taskrpc.bridges.door.door import read_policy
    from taskrpc.bridges.door.explanation import explain
    from taskrpc.bridges.door.policy_file import Known

    known: Known | None = None
    if options.running:
        from taskrpc.cli.ros.topic.topic_graph import topics
        from taskrpc.cli.shared import graph
        from taskrpc.cli.shared.remote import HERE
        from taskrpc.spi import suggestions

        entries = graph.look(HERE)
        services = suggestions.services(entries, hidden=True)
        known = Known(set(services), set(topics(entries, hidden=True)))
    for name, rules in read_policy(options.file, known).names.items():
        print(*explain(name, rules), sep="\n")
    return Exit.DONE


def _explain(options: argparse.Namespace) -> int:
    from srvgen.definitions.names import did_you_mean
    from taskrpc.bridges.door.door import policy_text
    from taskrpc.bridges.door.explanation import explain
    from taskrpc.bridges.door.policy_file import parse_policy

    text = policy_text(options.file)
    policy = parse_policy(text, options.file)
    if options.name is not None and options.name not in policy.names:
        problem = f"{options.file} has no rules for {options.name!r}"
        raise hinted(NotFound(problem), did_you_mean(options.name, policy.names))
    if options.service_name is not None:
        return _decide(options, policy, text)
    for name, rules in policy.names.items():
        if options.name in (None, name):
            print(*explain(name, rules), sep="\n")
    return Exit.DONE


def _decide(options: argparse.Namespace, policy: Policy, text: str) -> int:
    """Print the decision for one request now, and the line of its rule."""
    from taskrpc.bridges.door.decisions import Counts, Outcome, decide
    from taskrpc.bridges.door.door import present
    from taskrpc.spi import names

    target = names.expand(options.service_name, kind="name")
    message = _message(options.message)
    decision, _ = decide(policy, options.name, options.verb, target, message, present(), Counts())
    print(decision)
    if decision.line:
        print(f"    {text.splitlines()[decision.line - 1].strip()}")
    return Exit.ERROR if decision.outcome is Outcome.REFUSED else Exit.DONE


def _message(text: str | None) -> object:
    """Return the fields of a message. Raises InvalidRequest."""
    import yaml

    from taskrpc.errors import InvalidRequest
    from taskrpc.spi import yaml_text

    if text is None:
        return {}
    try:
        found = yaml_text.load(text)
    except yaml.YAMLError as error:
        problem = yaml_text.message(error)
    else:
        if isinstance(found, dict):
            return found
        problem = "it has no fields"
    raise InvalidRequest("", f"expected YAML such as {{priority: 3}}, got {text!r}: {problem}")
