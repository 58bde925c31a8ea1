"""What air, roll and compliance add to the car; all of it is zero by default."""

from dataclasses import replace

import numpy as np
import pytest

from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, parameters
from vehicle_plant.circular_driving import CircleParams

DRIVEN = yaml_parameters.load(CircleParams, parameters.config_file('identify.yaml'))
GENTLE = replace(DRIVEN, last_front_slip_rad=0.04)


def with_axles(params, **changes):
    suspension = params.car.suspension
    axles = {name: replace(getattr(suspension, name), **values) for name, values in changes.items()}
    return replace(params, car=replace(params.car, suspension=replace(suspension, **axles)))


def gradient(plant):
    """Return the understeer gradient over lateral acceleration [rad/(m/s^2)] up to 3 m/s^2."""
    track = circular_driving.drive(plant, 1.0, GENTLE)
    body = plant.car.body
    ay = track.column('acceleration.ay')
    curvature = track.column('planar.r') / track.column('planar.vx')
    excess = track.column('servos.steer.position')
    excess = excess - (body.cog_to_front_m + body.cog_to_rear_m) * curvature
    some = (ay > 0.5) & (ay < 3.0)
    return np.polyfit(ay[some], excess[some], 1)[0], track, some


@pytest.mark.parametrize('axle', ['front', 'rear'])
def test_compliance_steer_adds_its_coefficient_times_the_axle_mass(params, axle):
    """dK = c m_axle: the angle per force times the force per lateral acceleration."""
    c = 1e-6
    body = params.car.body
    arm = body.cog_to_rear_m if axle == 'front' else body.cog_to_front_m
    mass = body.mass_kg * arm / (body.cog_to_front_m + body.cog_to_rear_m)
    before, *_ = gradient(params)
    after, *_ = gradient(with_axles(params, **{axle: {'compliance_steer_radpn': c}}))
    assert after - before == pytest.approx(c * mass, rel=0.02)


@pytest.mark.parametrize('axle', ['front', 'rear'])
def test_roll_steer_adds_its_coefficient_times_the_roll_gradient(params, axle):
    before, track, some = gradient(params)
    roll = np.polyfit(track.column('acceleration.ay')[some], track.column('ride.phi')[some], 1)[0]
    assert roll > 0
    after, *_ = gradient(with_axles(params, **{axle: {'roll_steer': 0.05}}))
    assert after - before == pytest.approx(0.05 * roll, rel=0.05)


def test_lift_unloads_its_axle_by_the_pressure_of_the_air(params, drive):
    """Straight at constant speed: the load that is missing is lift, also in the moment of pitch."""
    speed = 40.0
    lift_area = {'front': 0.15, 'rear': 0.1}
    body = replace(
        params.car.body,
        front_lift_area_m2=lift_area['front'],
        rear_lift_area_m2=lift_area['rear'],
    )
    light = replace(params, car=replace(params.car, body=body))

    def hold(t, car):
        return 0.0, 0.0, 4000.0 * (speed - car.state.vx)

    tracks = [drive(hold, 3.0, speed, plant=plant) for plant in (params, light)]
    q = body.air_density_kgpm3 / 2 * tracks[1].column('planar.vx')[-1] ** 2
    for axle in ('front', 'rear'):
        loads = [
            sum(track.column(f'loads.{axle[0]}{side}.Fz')[-1] for side in 'lr') for track in tracks
        ]
        assert loads[0] - loads[1] == pytest.approx(q * lift_area[axle], rel=0.01)


def test_default_car_has_neither(params):
    car = params.car
    assert car.body.front_lift_area_m2 == car.body.rear_lift_area_m2 == 0.0
    for axle in (car.suspension.front, car.suspension.rear):
        assert axle.roll_steer == axle.compliance_steer_radpn == 0.0
