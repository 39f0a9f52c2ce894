"""What the core offers to the districts around it, and to packages that extend taskrpc.

A transport, a store, an observer or a command imports the names of this module; all other modules
of `taskrpc.core` may change at any time. `docs/explanation/contract.md` says who uses each name.
A name is imported when a program first uses it.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False
if TYPE_CHECKING:
    from taskrpc.actions.goals import GoalLedger, GoalRecord, goals_to_cancel
    from taskrpc.actions.messages import (
        FEEDBACK_QOS,
        STATUS_QOS,
        ActionMessages,
        bytes_of,
        nanoseconds_of,
        states_in,
    )
    from taskrpc.actions.names import action_of_feedback, names_of
    from taskrpc.actions.states import GoalEvent, InvalidTransition
    from taskrpc.core import names, yaml_document, yaml_text
    from taskrpc.core.callinfo import Denied, answering
    from taskrpc.core.current_program import current_program
    from taskrpc.core.exactly_once.completions import CompletionBatch, CompletionIndex
    from taskrpc.core.exactly_once.executions import Execution
    from taskrpc.core.exactly_once.stores import (
        clear_completions,
        create_completion_tables,
        read_stored_completions,
    )
    from taskrpc.core.execution.callbacks import problem_of_callback
    from taskrpc.core.execution.daemon_threads import DaemonThreads
    from taskrpc.core.introspection import SUFFIX, IntrospectionState, gid_of, service_event
    from taskrpc.core.observer import Connections, ObservedNode, Outgoing, TopicStatus
    from taskrpc.core.request_ids.ids import (
        ClientKey,
        Completion,
        CompletionStore,
        ReceivedId,
        StoredCompletions,
    )
    from taskrpc.core.request_ids.ledger import CLIENT_LEASE
    from taskrpc.core.security.account_file import AccountFile, Row
    from taskrpc.core.security.accounts import AccountSource
    from taskrpc.core.security.installing import install_command
    from taskrpc.core.security.lab import (
        Lab,
        forget_lab,
        remember_lab,
        remembered_lab,
        robot_namespace,
    )
    from taskrpc.core.security.listen_policy import check_listen_policy
    from taskrpc.core.security.roles import account_name_problem, account_of
    from taskrpc.core.security.tls import ServerTls, first_certificate, pinned_context
    from taskrpc.core.storage.database import Database
    from taskrpc.core.storage.lock import FileInUse
    from taskrpc.core.storage.records import Damaged, read_records, with_checksum
    from taskrpc.core.storage.table_checks import refuse_other_tables
    from taskrpc.core.storage.writer import Writer
    from taskrpc.core.system import (
        file_locks,
        folders,
        os_errors,
        private_files,
        process_state,
        signals,
        terminal,
    )
    from taskrpc.core.text_file import read_text
    from taskrpc.core.transport import suggestions
    from taskrpc.core.transport.base import (
        Deliver,
        OnDone,
        OnMismatch,
        ProgramStatistics,
        TopicPublisher,
        TopicSubscription,
    )
    from taskrpc.core.transport.chance import present_chance
    from taskrpc.core.transport.codec import KEPT_CLASSES, ServiceType, codec_of
    from taskrpc.core.transport.connection.dialling import with_address
    from taskrpc.core.transport.discovery.entries import (
        EntryChange,
        RegistryEntry,
        TrackedEntry,
        entry_of,
    )
    from taskrpc.core.transport.discovery.registry import Registry, domain_folder
    from taskrpc.core.transport.endpoint import Endpoint
    from taskrpc.core.transport.engine import (
        Cancelable,
        Closable,
        Engine,
        EngineEvents,
        ForeignServer,
        NativeEngine,
        NativeReply,
    )
    from taskrpc.core.transport.limits.keepalive import drop_dead_peers, keepalive_of
    from taskrpc.core.transport.limits.log_throttling import ThrottledLog
    from taskrpc.core.transport.memory import Hub, MemoryNetwork
    from taskrpc.core.transport.network import Address, Factory, Network
    from taskrpc.core.transport.settings import Settings, domain_id, environment_peers
    from taskrpc.core.transport.shared_endpoint import (
        TRANSPORTS,
        Registration,
        close_program,
        registered,
    )
    from taskrpc.core.transport.tcp.listening import Listener
    from taskrpc.core.transport.tcp.tcp_network import (
        TcpNetwork,
        address_here,
        is_loopback,
        join_address,
        listening_socket,
        split_address,
    )
    from taskrpc.core.transport.tcp.unix_sockets import checked_unix, is_unix, path_of
    from taskrpc.core.transport.time_of_day import time_of_day, time_of_day_ns
    from taskrpc.core.transport.tunnel import cdr
    from taskrpc.core.transport.tunnel.directory import entry_in
    from taskrpc.core.transport.tunnel.handoff import Handoff
    from taskrpc.core.transport.tunnel.tunnel_network import TunnelNetwork
    from taskrpc.core.wire.frames import Body
    from taskrpc.core.wire.messages import Listing, Resolve, ServiceEndpoint, TopicEndpoint
    from taskrpc.core.wire.statistics import ServiceStatistics, Statistics, percentile
    from taskrpc.core.wire.topics import qos_mismatch_text
    from taskrpc.sync.loop_thread import LoopThread
    from taskrpc.testing.fault_specs import Fault, FaultKind
    from taskrpc.testing.faulty_connections import FaultyConnection, NetworkFaults

_HOMES = {
    "actions.goals": "GoalLedger GoalRecord goals_to_cancel",
    "actions.messages": "FEEDBACK_QOS STATUS_QOS ActionMessages bytes_of nanoseconds_of states_in",
    "actions.names": "action_of_feedback names_of",
    "actions.states": "GoalEvent InvalidTransition",
    "core": "names yaml_document yaml_text",
    "core.callinfo": "Denied answering",
    "core.current_program": "current_program",
    "core.exactly_once.completions": "CompletionBatch CompletionIndex",
    "core.exactly_once.executions": "Execution",
    "core.exactly_once.stores": (
        "clear_completions create_completion_tables read_stored_completions"
    ),
    "core.execution.callbacks": "problem_of_callback",
    "core.execution.daemon_threads": "DaemonThreads",
    "core.introspection": "SUFFIX IntrospectionState gid_of service_event",
    "core.observer": "Connections ObservedNode Outgoing TopicStatus",
    "core.request_ids.ids": "ClientKey Completion CompletionStore ReceivedId StoredCompletions",
    "core.request_ids.ledger": "CLIENT_LEASE",
    "core.security.account_file": "AccountFile Row",
    "core.security.accounts": "AccountSource",
    "core.security.installing": "install_command",
    "core.security.lab": "Lab forget_lab remember_lab remembered_lab robot_namespace",
    "core.security.listen_policy": "check_listen_policy",
    "core.security.roles": "account_name_problem account_of",
    "core.security.tls": "ServerTls first_certificate pinned_context",
    "core.storage.database": "Database",
    "core.storage.lock": "FileInUse",
    "core.storage.records": "Damaged read_records with_checksum",
    "core.storage.table_checks": "refuse_other_tables",
    "core.storage.writer": "Writer",
    "core.system": "file_locks folders os_errors private_files process_state signals terminal",
    "core.text_file": "read_text",
    "core.transport": "suggestions",
    "core.transport.base": (
        "Deliver OnDone OnMismatch ProgramStatistics TopicPublisher TopicSubscription"
    ),
    "core.transport.chance": "present_chance",
    "core.transport.codec": "KEPT_CLASSES ServiceType codec_of",
    "core.transport.connection.dialling": "with_address",
    "core.transport.discovery.entries": "EntryChange RegistryEntry TrackedEntry entry_of",
    "core.transport.discovery.registry": "Registry domain_folder",
    "core.transport.endpoint": "Endpoint",
    "core.transport.engine": (
        "Cancelable Closable Engine EngineEvents ForeignServer NativeEngine NativeReply"
    ),
    "core.transport.limits.keepalive": "drop_dead_peers keepalive_of",
    "core.transport.limits.log_throttling": "ThrottledLog",
    "core.transport.memory": "Hub MemoryNetwork",
    "core.transport.network": "Address Factory Network",
    "core.transport.settings": "Settings domain_id environment_peers",
    "core.transport.shared_endpoint": "TRANSPORTS Registration close_program registered",
    "core.transport.tcp.listening": "Listener",
    "core.transport.tcp.tcp_network": (
        "TcpNetwork address_here is_loopback join_address listening_socket split_address"
    ),
    "core.transport.tcp.unix_sockets": "checked_unix is_unix path_of",
    "core.transport.time_of_day": "time_of_day time_of_day_ns",
    "core.transport.tunnel": "cdr",
    "core.transport.tunnel.directory": "entry_in",
    "core.transport.tunnel.handoff": "Handoff",
    "core.transport.tunnel.tunnel_network": "TunnelNetwork",
    "core.wire.frames": "Body",
    "core.wire.messages": "Listing Resolve ServiceEndpoint TopicEndpoint",
    "core.wire.statistics": "ServiceStatistics Statistics percentile",
    "core.wire.topics": "qos_mismatch_text",
    "sync.loop_thread": "LoopThread",
    "testing.fault_specs": "Fault FaultKind",
    "testing.faulty_connections": "FaultyConnection NetworkFaults",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "CLIENT_LEASE",
    "FEEDBACK_QOS",
    "KEPT_CLASSES",
    "STATUS_QOS",
    "SUFFIX",
    "TRANSPORTS",
    "AccountFile",
    "AccountSource",
    "ActionMessages",
    "Address",
    "Body",
    "Cancelable",
    "ClientKey",
    "Closable",
    "Completion",
    "CompletionBatch",
    "CompletionIndex",
    "CompletionStore",
    "Connections",
    "DaemonThreads",
    "Damaged",
    "Database",
    "Deliver",
    "Denied",
    "Endpoint",
    "Engine",
    "EngineEvents",
    "EntryChange",
    "Execution",
    "Factory",
    "Fault",
    "FaultKind",
    "FaultyConnection",
    "FileInUse",
    "ForeignServer",
    "GoalEvent",
    "GoalLedger",
    "GoalRecord",
    "Handoff",
    "Hub",
    "IntrospectionState",
    "InvalidTransition",
    "Lab",
    "Listener",
    "Listing",
    "LoopThread",
    "MemoryNetwork",
    "NativeEngine",
    "NativeReply",
    "Network",
    "NetworkFaults",
    "ObservedNode",
    "OnDone",
    "OnMismatch",
    "Outgoing",
    "ProgramStatistics",
    "ReceivedId",
    "Registration",
    "Registry",
    "RegistryEntry",
    "Resolve",
    "Row",
    "ServerTls",
    "ServiceEndpoint",
    "ServiceStatistics",
    "ServiceType",
    "Settings",
    "Statistics",
    "StoredCompletions",
    "TcpNetwork",
    "ThrottledLog",
    "TopicEndpoint",
    "TopicPublisher",
    "TopicStatus",
    "TopicSubscription",
    "TrackedEntry",
    "TunnelNetwork",
    "Writer",
    "account_name_problem",
    "account_of",
    "action_of_feedback",
    "address_here",
    "answering",
    "bytes_of",
    "cdr",
    "check_listen_policy",
    "checked_unix",
    "clear_completions",
    "close_program",
    "codec_of",
    "create_completion_tables",
    "current_program",
    "domain_folder",
    "domain_id",
    "drop_dead_peers",
    "entry_in",
    "entry_of",
    "environment_peers",
    "file_locks",
    "first_certificate",
    "folders",
    "forget_lab",
    "gid_of",
    "goals_to_cancel",
    "install_command",
    "is_loopback",
    "is_unix",
    "join_address",
    "keepalive_of",
    "listening_socket",
    "names",
    "names_of",
    "nanoseconds_of",
    "os_errors",
    "path_of",
    "percentile",
    "pinned_context",
    "present_chance",
    "private_files",
    "problem_of_callback",
    "process_state",
    "qos_mismatch_text",
    "read_records",
    "read_stored_completions",
    "read_text",
    "refuse_other_tables",
    "registered",
    "remember_lab",
    "remembered_lab",
    "robot_namespace",
    "service_event",
    "signals",
    "split_address",
    "states_in",
    "suggestions",
    "terminal",
    "time_of_day",
    "time_of_day_ns",
    "with_address",
    "with_checksum",
    "yaml_document",
    "yaml_text",
]


if not TYPE_CHECKING:  # or type checkers would accept every missing name as Any

    def __getattr__(name):
        home = _HOME_OF.get(name)
        if home is None:
            raise AttributeError(f"module 'taskrpc.spi' has no attribute {name!r}")
        module = import_module(f"taskrpc.{home}")
        value = getattr(module, name, None) or import_module(f"taskrpc.{home}.{name}")
        globals()[name] = value
        return value
