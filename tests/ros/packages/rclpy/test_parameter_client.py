"""A client gets and sets the parameters of another node."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.parameter import Parameter, parameter_value_to_python
from taskrpc.ros.packages.rclpy.parameter_client import AsyncParameterClient

pytestmark = pytest.mark.real_time


Descriptor = srvgen.load("rcl_interfaces/msg/ParameterDescriptor")


def test_client_gets_values_by_name(pair):
    found = pair.answer(pair.client.get_parameters(["speed", "names", "g.x"])).values
    assert [parameter_value_to_python(one) for one in found] == [1.5, ["a", "b"], [1, 2]]
    assert list(pair.answer(pair.client.get_parameter_types(["speed", "g.x"])).types) == [3, 7]
    assert pair.answer(pair.client.describe_parameters(["speed"])).descriptors == [
        Descriptor(name="speed", type=3)
    ]


def test_undeclared_parameter_gives_an_empty_response(pair):
    pair.target.declare_parameter("later", Parameter.Type.STRING)
    assert pair.answer(pair.client.get_parameters(["speed", "none"])).values == []
    assert pair.answer(pair.client.get_parameters(["later"])).values == []
    assert list(pair.answer(pair.client.get_parameter_types(["none"])).types) == []
    assert pair.answer(pair.client.describe_parameters(["none"])).descriptors == []


def test_names_are_listed_with_their_groups(pair):
    found = pair.answer(pair.client.list_parameters()).result
    assert set(found.names) > {"use_sim_time", "speed", "names", "g.x"}
    assert found.prefixes == ["g"]
    assert pair.answer(pair.client.list_parameters(["g"], 1)).result.names == ["g.x"]


def test_a_file_is_loaded_and_the_callback_receives_the_results(pair, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("/ns/target: {ros__parameters: {speed: 4.5, names: [c]}}", encoding="utf-8")
    told = []
    pair.answer(pair.client.load_parameter_file(str(path), callback=told.append))
    assert pair.target.get_parameter("names").value == ["c"]
    answer = pair.answer(pair.client.load_parameter_file_atomically(str(path)))
    assert answer.result.successful
    assert len(told) == 1


def test_wait_for_missing_services_ends_at_its_timeout(pair):
    client = AsyncParameterClient(pair.asking, "nobody")
    assert not client.wait_for_services(timeout_sec=0.01)
