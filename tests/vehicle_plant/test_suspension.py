"""Wheel loads at rest and in motion; what lift, roll steer and compliance steer add."""

from dataclasses import replace

import numpy as np
import pytest

from msgs_yaml.types import WHEELS
from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, parameters
from vehicle_plant.circular_driving import CircleParams
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator


def loads(track):
    return {w: track.column(f'loads.{w}.Fz')[-1] for w in WHEELS}


def test_standing_car_carries_its_weight(params):
    car = Simulator(params, 1.0, Start(1.0, 2.0, 0.3, 0.0))
    Fz = loads(car.advance(None, 3000))
    body = params.car.body
    weight = body.mass_kg * body.gravity_mps2
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    assert sum(Fz.values()) == pytest.approx(weight, rel=1e-4)
    assert Fz['fl'] + Fz['fr'] == pytest.approx(weight * body.cog_to_rear_m / wheelbase, rel=1e-4)
    assert Fz['fl'] == pytest.approx(Fz['fr'], rel=1e-9)


def test_standing_car_stays_where_it_is(params):
    car = Simulator(params, 1.0, Start(1.0, 2.0, 0.3, 0.0))
    before = car.state
    car.advance(None, 3000)
    after = car.state
    # static camber settles against the links: some tens of micrometres
    assert abs(after.X - before.X) + abs(after.Y - before.Y) < 1e-4
    assert abs(after.vx) < 1e-3


def test_lateral_transfer_is_height_times_lateral_force(params, drive):
    track = drive(lambda t, car: (0.03, 0.0, 300.0), 4.0, 20.0)
    Fz = loads(track)
    body, axles = params.car.body, params.car.suspension
    front = (Fz['fr'] - Fz['fl']) / 2 * axles.front.track_m
    rear = (Fz['rr'] - Fz['rl']) / 2 * axles.rear.track_m
    ay = track.column('acceleration.ay')[-1]
    phi = track.column('ride.phi')[-1]
    unsprung = 2 * (axles.front.unsprung_mass_kg + axles.rear.unsprung_mass_kg)
    heights = axles.front.roll_centre_height_m, axles.rear.roll_centre_height_m
    arms = np.array([body.cog_to_rear_m, body.cog_to_front_m])
    arm = body.cog_height_m - np.dot(heights, arms) / arms.sum()
    shifted = (body.mass_kg - unsprung) * body.gravity_mps2 * arm * phi
    expected = body.mass_kg * ay * body.cog_height_m + shifted
    assert front + rear == pytest.approx(expected, rel=2e-3)
    assert 0.5 < front / (front + rear) < 0.7


def test_longitudinal_transfer_is_height_times_deceleration(params, drive):
    track = drive(lambda t, car: (0.0, -5000.0, -3000.0), 2.0, 25.0)
    Fz = loads(track)
    body, axles = params.car.body, params.car.suspension
    ax = track.column('acceleration.ax')[-1]
    theta = track.column('ride.theta')[-1]
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    unsprung = 2 * (axles.front.unsprung_mass_kg + axles.rear.unsprung_mass_kg)
    heights = axles.front.pitch_centre_height_m, axles.rear.pitch_centre_height_m
    arms = np.array([body.cog_to_rear_m, body.cog_to_front_m])
    arm = body.cog_height_m - np.dot(heights, arms) / wheelbase
    shifted = (body.mass_kg - unsprung) * body.gravity_mps2 * arm * theta
    front = Fz['fl'] + Fz['fr'] - body.mass_kg * body.gravity_mps2 * body.cog_to_rear_m / wheelbase
    assert theta > 0.01
    # drag acts at the height of the CoG, hence without a moment
    drag = 0.5 * body.air_density_kgpm3 * body.drag_area_m2 * track.column('planar.vx')[-1] ** 2
    expected = ((-body.mass_kg * ax - drag) * body.cog_height_m + shifted) / wheelbase
    assert front == pytest.approx(expected, rel=5e-3)


def test_body_rolls_outwards_as_much_as_such_cars_do(drive):
    track = drive(lambda t, car: (0.02, 0.0, 300.0), 4.0, 25.0)
    gain = track.column('ride.phi')[-1] / (track.column('acceleration.ay')[-1] / 9.81)
    assert 3.0 < np.degrees(gain) < 4.5


def test_lifted_wheel_pushes_nothing(drive):
    """On a road of twice the usual grip a swerve lifts the inner wheels."""
    track = drive(lambda t, car: (0.16 * np.sin(4 * t), 0.0, 0.0), 1.2, 25.0, friction=2.0)
    Fz = np.array([track.column(f'loads.{w}.Fz') for w in WHEELS])
    Fy = np.array([track.column(f'loads.{w}.Fy') for w in WHEELS])
    assert np.abs(track.column('ride.phi')).max() < 0.3
    assert Fz.min() == 0.0
    assert np.abs(Fy[Fz == 0.0]).max() < 5.0


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
    linear = (ay > 0.5) & (ay < 3.0)
    return np.polyfit(ay[linear], excess[linear], 1)[0], track, linear


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
    before, track, linear = gradient(params)
    roll = np.polyfit(track.column('acceleration.ay')[linear], track.column('ride.phi')[linear], 1)[
        0
    ]
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


def test_default_car_has_no_lift_roll_steer_or_compliance_steer(params):
    car = params.car
    assert car.body.front_lift_area_m2 == car.body.rear_lift_area_m2 == 0.0
    for axle in (car.suspension.front, car.suspension.rear):
        assert axle.roll_steer == axle.compliance_steer_radpn == 0.0
