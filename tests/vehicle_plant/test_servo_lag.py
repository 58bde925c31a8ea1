"""The lag of the servos on a ramp against the closed form of a second-order servo."""

from dataclasses import replace

import pytest

from vehicle_plant import parameters, servo_lag


@pytest.mark.parametrize('car', ['bmw_330i.yaml', 'bmw_545i.yaml', 'vw_gti.yaml'])
def test_on_a_ramp_a_servo_is_behind_by_twice_its_damping_over_its_frequency(car):
    plant = parameters.load(parameters.config_file(car))
    lags = servo_lag.measure(plant, 1.0)
    steering, force = plant.car.steering, plant.car.force.front
    expected = 2 * steering.damping / steering.natural_frequency_radps + steering.delay_ms / 1e3
    assert lags.steer_s == pytest.approx(expected, abs=2e-4)
    expected = 2 * force.damping / force.natural_frequency_radps + force.delay_ms / 1e3
    assert lags.force_s == pytest.approx(expected, abs=2e-4)


def test_a_delay_before_the_servo_is_part_of_the_lag(params):
    steering = replace(params.car.steering, delay_ms=30)
    delayed = replace(params, car=replace(params.car, steering=steering))
    more = servo_lag.measure(delayed, 1.0).steer_s - servo_lag.measure(params, 1.0).steer_s
    assert more == pytest.approx(0.03, abs=1e-6)
