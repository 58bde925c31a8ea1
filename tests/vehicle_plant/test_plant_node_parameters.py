"""The node drives the car, tyre, road and start that its parameters say, or does not start."""

from dataclasses import replace

import numpy as np
import pytest
from plant_process import run, weave

from msgs_yaml import decode, encode
from msgs_yaml.types import Command, Reference
from node_runtime import ros, spin_node
from vehicle_plant import parameters, road_friction
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import START_NS, TICK_NS, Simulator

pytestmark = pytest.mark.usefixtures('domain')


def test_car_starts_at_the_first_pose_of_the_path():
    path = Reference(
        START_NS,
        np.array([3.0, 13.0]),
        np.array([-2.0, -2.0]),
        np.array([0.0, 0.0]),
        np.array([0.0, 1.0]),
    )

    def with_path(controller):
        controller.reference_pub = ros.publisher(controller, '/scenario/reference')
        controller.reference_pub.publish(encode.reference(path))

    settings = {'start.from': 'reference', 'stop.time_s': 0.5}
    done = run(weave, before=with_path, **settings)
    first = done.controller.state(0)
    assert first == (START_NS, 3.0, -2.0, 0.0, 10.0, 0.0, 0.0)


def test_misspelt_parameter_stops_the_node():
    done = run(weave, **{'stop.xm': 3.0})
    assert done.exit_code == spin_node.EXIT_CONFIGURATION
    assert 'stop.xm' in done.log


def test_another_car_on_another_tyre_and_a_road_with_ice(tmp_path):
    """Selected by parameters; what is sent is what the core computes for them."""
    tyre_file = tmp_path / 'my.tir'
    tyre_file.write_text(
        '[MODEL]\nFITTYP = 61\n[VERTICAL]\nFNOMIN = 4000\n'
        '[LONGITUDINAL_COEFFICIENTS]\nPCX1 = 1.6\nPDX1 = 1\nPKX1 = 16\nRBX1 = 8\nRCX1 = 0.9\n'
        '[LATERAL_COEFFICIENTS]\nPCY1 = 1.3\nPDY1 = 1\nPKY1 = -15\nPKY2 = 2\nRBY1 = 5\nRCY1 = 1\n'
    )
    ice = [2.0, 0.0, 90.0, 0.0, 90.0, 9.0, 2.0, 9.0]
    settings = {'patches.corners_m': ice, 'patches.friction': [0.2], 'stop.x_m': 8.0}

    def brake(stamp_ns):
        return encode.command(Command(stamp_ns, 0.0, 0.0, -4000.0, -1500.0))

    done = run(brake, plant_params='vw_gti.yaml', tyre_set=str(tyre_file), **settings)
    assert done.exit_code == 0, done.log
    plant = parameters.load(parameters.config_file('vw_gti.yaml'))
    plant = replace(plant, tyre=parameters.load_tyre(str(tyre_file)))
    car = Simulator(
        plant, 1.0, Start(0.0, 0.0, 0.0, 20.0), patches=road_friction.patch_array(ice, [0.2])
    )
    ticks = (done.controller.stamps('odometry')[-1] - START_NS) // TICK_NS
    for i in range(ticks):
        car.advance(decode.command(brake(START_NS + i * TICK_NS)), 50)
    last = done.controller.state(-1)
    assert last[:3] == car.state[:3]
    assert last[4:] == car.state[4:]
    assert last.psi < -1e-4  # towards the side with grip


@pytest.mark.parametrize(
    'settings',
    [
        {'plant_params': 'nobody.yaml'},
        {'tyre_set': '/nowhere/my.tir'},
        {'patches.friction': [0.5]},
    ],
)
def test_car_tyre_or_road_that_is_not_there_stops_the_node(settings):
    done = run(weave, **settings)
    assert done.exit_code == spin_node.EXIT_CONFIGURATION
    (name,) = settings
    assert name.partition('.')[0] in done.log or str(settings[name]) in done.log


def test_on_request_imu_and_wheels_come_with_every_step():
    done = run(weave, **{'stop.x_m': 5.0, 'imu_wheels_period_ms': 1})
    odometry = done.controller.stamps('odometry')
    assert len(odometry) > 200
    assert done.controller.stamps('imu') == done.controller.stamps('wheels') == odometry
