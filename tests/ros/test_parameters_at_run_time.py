"""Every parameter of every node is described; a change is refused with a reason where it cannot be.

What may be changed is in test_life_cycle.py and test_run_time_parameters.py.
"""

from itertools import cycle

import pytest
import rclpy
from node_graph import ROLES, NodeGraph
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from mpcc_controller import run_time_parameters
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import share
from node_runtime import parameters, spin_node
from node_runtime.parameters import RUN_TIME

pytestmark = pytest.mark.usefixtures('domain')
OF_ROS = ('use_sim_time', 'start_type_description_service')
PATIENCE_S = 120.0
MPCC = parameters.load(ControllerParams, share.path('mpcc_controller', 'config', 'mpcc.yaml'))
CHANGEABLE = dict.fromkeys(ROLES, frozenset()) | {'controller': run_time_parameters.names(MPCC)}


@pytest.fixture(scope='module')
def asked(domain, tmp_path_factory):
    """Return ask(role, service type, request) of a running graph."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('asking', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def ask(role, service, request):
        name = (
            f'/{role}/'
            + {
                ListParameters: 'list_parameters',
                DescribeParameters: 'describe_parameters',
                GetParameters: 'get_parameters',
                SetParameters: 'set_parameters',
            }[service]
        )
        client = node.create_client(service, name)
        assert client.wait_for_service(PATIENCE_S), name
        future = client.call_async(request)
        executor.spin_until_future_complete(future, timeout_sec=PATIENCE_S)
        node.destroy_client(client)
        return future.result()

    slow = {'plant': {'stop.x_m': 1e4, 'stop.time_s': RUN_TIME.high}}
    with NodeGraph(tmp_path_factory.mktemp('graph'), domain, mode='realtime', **slow) as graph:
        for role in ROLES:
            graph.start(role)
        graph.wait_for('controller', 'ready')
        yield ask
    spin_node.shut_down(node, context=context)


def names(ask, role):
    listed = ask(role, ListParameters, ListParameters.Request()).result.names
    return [n for n in listed if n not in OF_ROS and not n.startswith('qos_overrides')]


@pytest.mark.parametrize('role', ROLES)
def test_every_parameter_says_what_it_is_and_what_it_may_be(asked, role):
    found = names(asked, role)
    assert {'mode', 'recorders'} <= set(found)
    told = asked(role, DescribeParameters, DescribeParameters.Request(names=found))
    for one in told.descriptors:
        assert one.description, one.name
        assert one.read_only == (one.name not in CHANGEABLE[role]), one.name


@pytest.mark.parametrize('role', ROLES)
def test_a_change_at_run_time_is_refused_with_a_reason_and_the_old_value_stays(asked, role):
    found = [name for name in names(asked, role) if name not in CHANGEABLE[role]]
    before = asked(role, GetParameters, GetParameters.Request(names=found)).values
    request = SetParameters.Request()
    for name, value in zip(found, cycle((1.5, -1, 'other', True, [1.0], float('nan')))):
        request.parameters.append(Parameter(name, value=value).to_parameter_msg())
    results = asked(role, SetParameters, request).results
    assert len(results) == len(request.parameters)
    for one, result in zip(request.parameters, results):
        assert not result.successful, one.name
        assert 'read-only' in result.reason, (one.name, result.reason)
    after = asked(role, GetParameters, GetParameters.Request(names=found)).values
    assert repr(after) == repr(before)
