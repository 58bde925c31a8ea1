"""The controllers on the multi-body model of CommonRoad, with the car that `identify` finds."""

import re

import pytest

from bags.errors import BagError
from bags.evaluation import metrics
from experiments import simulation
from msgs_yaml import share
from vehicle_plant import identify, parameters

pytest.importorskip('vehiclemodels')
SCENARIO = 'double_lane_change'
PLANT = {'plant_params': parameters.MULTI_BODY_CAR}
CONTROLLER = {'car_file': 'car_commonroad_320i.yaml'}


def prepare(controller='mpcc', speed_mps=75 / 3.6, **plant):
    settings = {'plant': PLANT | plant, 'controller': CONTROLLER}
    return simulation.prepare(SCENARIO, controller, settings, speed_mps)


@pytest.mark.parametrize('controller', ['mpcc', 'frenet'])
def test_the_double_lane_change_succeeds(controller):
    found = metrics.compute_metrics(simulation.drive(prepare(controller)))
    assert found['completed']
    assert not found['collided']
    assert found['min_v2e_m'] > 0.0
    assert found['fallbacks'] == 0
    # the run reaches the limit of this car, 8.7 m/s^2 in a steady turn
    assert found['peak_lat_acc_mps2'] > 8.0


def test_below_the_limit_it_moves_nearly_as_the_double_track_of_the_same_car():
    """At 50 km/h the peaks of the heading agree within 3 %, and are not the same."""
    headings = []
    for car in (parameters.MULTI_BODY_CAR, 'bmw_320i.yaml'):
        columns = simulation.run(prepare('mpcc_no_ca', 50 / 3.6, plant_params=car), explain=False)
        headings.append(abs(columns['/vehicle/odometry'].yaw_rad).max())
    model, double_track = headings
    assert model == pytest.approx(double_track, rel=0.03)
    assert abs(model / double_track - 1) > 1e-4


def test_the_same_setup_gives_the_same_columns():
    odometry = [simulation.run(prepare(), explain=False)['/vehicle/odometry'] for _ in range(2)]
    for first, second in zip(*odometry):
        assert (first == second).all()


def test_the_friction_of_the_road_is_that_of_the_plant():
    """On ice it never reaches the lateral acceleration that it had on a dry road."""
    found = metrics.compute_metrics(simulation.drive(prepare(friction=0.4, speed_mps=60 / 3.6)))
    mu = 0.4 * 0.85 * 1.0489
    assert found['peak_lat_acc_mps2'] < 1.15 * mu * 9.81


def test_the_model_is_a_setting_of_its_own():
    """The same car file with the other model is the double track."""
    setup = prepare(model=parameters.DOUBLE_TRACK)
    assert not isinstance(setup.plant, type(prepare().plant))


def test_a_setting_without_effect_is_refused():
    with pytest.raises(BagError, match=r'car.body.mass_kg: is 1500.0; it does not change'):
        prepare(**{'car.body.mass_kg': 1500.0})


def test_the_car_file_of_the_controllers_is_what_identify_makes(tmp_path):
    out = tmp_path / 'car.yaml'
    assert identify.main(['--car', parameters.MULTI_BODY_CAR, '--out', str(out)]) == 0
    committed = share.path('mpcc_controller', 'config', CONTROLLER['car_file']).read_text()

    def numbers(text):
        # the last digits differ between processors
        return [float(x) for x in re.findall(r': (-?[\d.]+)', text)]

    assert numbers(out.read_text()) == pytest.approx(numbers(committed), rel=1e-3)
