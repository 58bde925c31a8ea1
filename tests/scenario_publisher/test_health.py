"""Telemetry may be of any size; it must not keep the scenario from speaking."""

import time

import pytest

from msgs_yaml import encode
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Health
from node_runtime import ros
from scenario_publisher import scenario_node

LONG_S = 0.02  # of processor time; less than half a tick


def serialized(values):
    return ros.serialize(encode.health(Health(10**18, 'plant', 0, 'running', values)))


def test_health_with_as_many_values_as_the_contract_allows_is_read():
    values = {
        f'age.something_long_{k}': 'a reason of some forty letters, as a node may give'
        for k in range(400)
    }
    assert scenario_node.read_health(serialized(values)).values == values


def test_absurdly_much_health_is_refused_before_it_is_looked_at():
    message = encode.health(Health(10**18, 'plant', 0, 'running', {'run_began_ns': 10**18}))
    message.status[0].values = list(message.status[0].values) * 20_000
    raw = ros.serialize(message)
    began = time.thread_time()
    with pytest.raises(DecodeError, match=r'/diagnostics: .* bytes; allowed 40000'):
        scenario_node.read_health(raw)
    assert time.thread_time() - began < LONG_S


def test_health_that_is_cut_off_is_refused():
    for length in (0, 1, 5, 20):
        with pytest.raises(DecodeError):
            scenario_node.read_health(serialized({'missed_steps': 3})[:length])
