"""The routes of a connection: method ids, and the answers to lookups, without a socket."""

import pytest

import taskrpc
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import Offer
from taskrpc.core.transport.connection import routes as routes_module
from taskrpc.core.transport.connection.incoming_call import ObservedCall, RemoteCall
from taskrpc.core.transport.connection.routes import Routes
from taskrpc.core.wire.messages import Resolve
from tests.core.test_observer import Spans
from tests.core.transport.helpers import Add, Text


def offer_of(srv_type=Add, **options):
    return Offer("/add", srv_type, "/server", lambda call: None, **options)


def added(routes, offer, method=1, caller="/client", faults=None):
    return routes.add(offer, method, caller, "ana", Role.SUBMIT, faults)


def test_each_pair_of_service_and_node_has_one_method_id():
    routes, offer = Routes(), offer_of()
    pairs = [(1, "/a"), (1, "/b"), (2, "/a"), (1, "/a")]
    assert [added(routes, offer, *pair) for pair in pairs] == [1, 2, 3, 1]
    assert [(route.method, route.caller) for route in routes.values()] == pairs[:3]


def test_unknown_service_is_refused_as_not_offered():
    refusal = Routes().refusal(Resolve("/nothing"), None)
    assert str(refusal.error) == "no service /nothing here"
    assert (refusal.exists, refusal.drains) == (False, False)


@pytest.mark.parametrize(("type_hash", "refused"), [("", False), (Add._HASH, False), ("x", True)])
def test_caller_with_another_definition_is_refused(type_hash, refused):
    refusal = Routes().refusal(Resolve("/add", type_hash), offer_of())
    assert (refusal is not None) == refused
    if refused:
        assert isinstance(refusal.error, taskrpc.TypeMismatch)
        assert refusal.exists


def test_connection_without_a_free_method_id_is_used_up(monkeypatch):
    monkeypatch.setattr(routes_module, "MAX_HANDLES", 2)
    routes, offer = Routes(), offer_of()
    for number in (1, 2):
        assert routes.refusal(Resolve("/add"), offer) is None
        added(routes, offer, number)
    refusal = routes.refusal(Resolve("/add"), offer)
    assert isinstance(refusal.error, taskrpc.ServerBusy)
    assert refusal.drains


def test_rerouted_services_keep_their_method_ids_and_removed_ones_their_routes():
    routes, offer = Routes(), offer_of()
    first, second = added(routes, offer, 1), added(routes, offer_of(Text), 2)
    observed = offer_of(observer=Spans())
    routes.reroute({1: offer}, {offer: observed}.__getitem__, None)
    assert routes[first].offer is observed
    assert [routes[each].call for each in (first, second)] == [ObservedCall, RemoteCall]
    assert routes[second].offer.srv_type is Text


def test_faults_are_in_new_and_in_rerouted_routes():
    class Faults:
        def __init__(self):
            self.seen = []

        def applied(self, route):
            self.seen.append(route.method)
            return route

    routes, offer, faults = Routes(), offer_of(), Faults()
    added(routes, offer, 7, faults=faults)
    routes.reroute({7: offer}, lambda each: each, faults)
    assert faults.seen == [7, 7]


def test_caller_without_the_needed_role_finds_the_service_but_cannot_call_it():
    routes = Routes()
    offer = offer_of(role=Role.ADMIN)
    assert routes.refusal(Resolve("/add"), offer) is None
    with pytest.raises(taskrpc.PermissionDenied, match="needs the role admin"):
        routes[added(routes, offer)].decode(b"\x92\x01\x02")
