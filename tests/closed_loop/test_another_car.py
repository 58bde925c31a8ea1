"""Another car: the file that `identify` writes is all that the controller must be given."""

import pytest

from bags.evaluation import metrics
from experiments import simulation
from vehicle_plant import identify

SCENARIO = 'double_lane_change'
PLANT = {'plant_params': 'vw_gti.yaml'}  # front-wheel drive, steers more slowly than mpcc.yaml asks


@pytest.fixture(scope='module')
def car(tmp_path_factory):
    """The file of the front-wheel-drive car."""
    out = tmp_path_factory.mktemp('car') / 'gti.yaml'
    assert identify.main(['--car', PLANT['plant_params'], '--out', str(out)]) == 0
    return str(out)


def driven(car, **more):
    settings = {'plant': PLANT, 'controller': {'car_file': car, **more}}
    return metrics.compute_metrics(simulation.drive(simulation.prepare(SCENARIO, 'mpcc', settings)))


def test_a_front_wheel_drive_car_drives_the_double_lane_change_with_its_file_alone(car):
    found = driven(car)
    assert found['completed']
    assert not found['collided']
    assert found['min_v2e_m'] > 0.3
    assert found['min_v2o_m'] > 0.5
    assert found['fallbacks'] == 0


def test_the_drive_layout_in_the_controller_wins_over_the_car_file(car):
    """The car leaves the road when its controller takes it for rear-wheel drive."""
    found = driven(car, **{'model.drive_front_share': 0.0})
    assert not found['completed'] or found['min_v2e_m'] < 0.0


def test_the_steering_rate_of_the_car_is_not_exceeded(car):
    settings = {'plant': PLANT, 'controller': {'car_file': car}}
    prepared = simulation.prepare(SCENARIO, 'mpcc', settings)
    assert prepared.params.limits.steer_rate_radps > 0.5
    columns = simulation.run(prepared)
    rate = abs(columns['/controller/command'].steer_rate_radps).max()
    assert rate == pytest.approx(0.349, rel=1e-6)
