"""Managed nodes over real Fast DDS: the services of their life cycle, and two runs in one process.

A pause in a drive and wrong files are in test_nodes_in_one_process.py.
"""

from lifecycle_msgs.msg import Transition
from node_graph import OF_PROCESSES, ROLES, Manager, NodeGraph

from bags.storage import read
from experiments.run import processes

pytestmark = OF_PROCESSES
COMMAND = '/controller/command'
ROUND = (
    ('configure', 'inactive'),
    ('activate', 'active'),
    ('deactivate', 'inactive'),
    ('activate', 'active'),
    ('deactivate', 'inactive'),
    ('cleanup', 'unconfigured'),
)


def test_each_node_runs_through_its_life_cycle_and_survives_impossible_requests(
    tmp_path, domain, wall_clock
):
    settings = wall_clock.with_priority()
    with (
        wall_clock.own_drive(),
        NodeGraph(tmp_path, domain, mode='realtime', **settings) as graph,
        Manager(domain) as manager,
    ):
        for role in ROLES:
            graph.nodes[role].parameters['autostart'] = False
            graph.start(role)
        for role in ROLES:
            assert manager.state(role) == 'unconfigured', graph.log(role)
            assert not manager.request(role, Transition.TRANSITION_ACTIVATE)
            for transition, state in ROUND:
                assert manager.request(role, transition), graph.log(role)
                assert manager.state(role) == state
            assert 'is not possible' in graph.log(role)
            assert graph.log(role).count('inactive: it publishes nothing until it is') == 2
            assert graph.log(role).count('unconfigured: it has left the graph') == 1
        for role in ROLES:
            for transition in ('configure', 'activate'):
                assert manager.request(role, transition), graph.log(role)
        assert graph.wait('plant') == 0, graph.log('plant')
        graph.wait_for('controller', 'nothing to brake')
        assert '[ERROR]' not in graph.log('controller').rpartition(' active')[2]
        for role in ('controller', 'scenario', 'recorder'):
            assert manager.request(role, 'shutdown'), graph.log(role)
            assert manager.state(role) == 'finalized'
        assert read.load(graph.bag).run_info
        bag = read.load(f'{graph.bag}_2')  # complete, although the process goes on
        assert len(bag.recordings[COMMAND].payloads) > 20
        processes.stop([graph.running[role] for role in ('controller', 'scenario', 'recorder')])
        assert {process.code for process in graph.running.values()} == {0}
