"""The plant against closed forms of small steering: how near it is, and what the rest is."""

from dataclasses import replace

import numpy as np
import pytest

from vehicle_plant import parameters
from vehicle_plant.manoeuvres import procedure, settings, sine_sweep, steady_circle
from vehicle_plant.manoeuvres.linear_single_track import linear_car, yaw_rate_response

GAIN, PHASE = 0.03, np.radians(5.0)
TWO_HERTZ = 2.0


@pytest.fixture(scope='module')
def plant():
    return parameters.load()


def case_of(plant, **sweep):
    given = settings.load()
    return procedure.Case(plant, 1.0, replace(given, sine_sweep=replace(given.sine_sweep, **sweep)))


def swept(plant, **sweep):
    case = case_of(plant, **sweep)
    (run,) = sine_sweep.runs(case)
    return case, procedure.drive(run, case)


def hung(plant, **axle):
    """Return the car with other numbers on both axles."""
    of = plant.car.suspension
    changed = replace(of, front=replace(of.front, **axle), rear=replace(of.rear, **axle))
    return replace(plant, car=replace(plant.car, suspension=changed))


def test_single_track_predicts_the_yaw_rate_up_to_half_a_hertz(plant):
    case, track = swept(plant)
    assert np.abs(track.column('acceleration.ay')).max() < 0.2 * plant.car.body.gravity_mps2
    gain, phase = sine_sweep.errors(case, track, 'single track', 0.5)
    assert gain < GAIN
    assert phase < PHASE


@pytest.mark.parametrize(
    ('car', 'speed'),
    [
        ('bmw_545i.yaml', 10.0),
        ('bmw_545i.yaml', 22.222),
        ('bmw_545i.yaml', 30.0),
        ('bmw_330i.yaml', 22.222),
        ('vw_gti.yaml', 22.222),
    ],
)
def test_relaxation_and_body_predict_the_yaw_rate_up_to_two_hertz(car, speed):
    plant = parameters.load(parameters.config_file(car))
    case, track = swept(plant, speed_mps=speed, frequencies_hz=(0.2, 0.5, 1.0, 1.4, 2.0), periods=2)
    assert np.abs(track.column('acceleration.ay')).max() < 0.2 * plant.car.body.gravity_mps2
    gain, phase = sine_sweep.errors(case, track, 'with relaxation and body', TWO_HERTZ)
    assert gain < 0.02
    assert phase < np.radians(1.0)


def test_camber_by_roll_and_load_transfer_are_what_relaxation_alone_lacks(plant):
    """3.3 % at the most of the whole car, below 3 % without camber, 0.8 % with all of the body."""
    case, track = swept(plant)
    alone, phase = sine_sweep.errors(case, track, 'with relaxation', TWO_HERTZ)
    assert phase < PHASE
    case_upright, track_upright = swept(hung(plant, camber_per_roll=0.0))
    upright, phase = sine_sweep.errors(case_upright, track_upright, 'with relaxation', TWO_HERTZ)
    assert phase < PHASE
    complete, _ = sine_sweep.errors(case, track, 'with relaxation and body', TWO_HERTZ)
    assert upright < GAIN
    assert complete < alone / 3
    assert upright < alone


def test_the_last_percent_is_drive_and_amplitude(plant):
    """Without resistance nothing needs to be driven: at a hundredth of g the form is exact."""
    car = plant.car
    free = replace(
        plant,
        car=replace(
            car,
            body=replace(car.body, drag_area_m2=0.0),
            wheel=replace(car.wheel, rolling_resistance=0.0),
        ),
    )
    case, track = swept(free, ay_mps2=0.1, frequencies_hz=(0.2, 0.5, 1.0, 2.0), periods=2)
    gain, phase = sine_sweep.errors(case, track, 'with relaxation and body', TWO_HERTZ)
    assert gain < 1e-3
    assert phase < np.radians(0.1)


def test_wheels_that_steer_by_roll_and_force_are_in_the_form(plant):
    """At a twentieth of g, where the wheels turn by some tenths of the steer."""
    steering = hung(plant, roll_steer=0.08, compliance_steer_radpn=4e-7)
    case, track = swept(steering, ay_mps2=0.5, frequencies_hz=(0.2, 1.0, 2.0), periods=2)
    gain, phase = sine_sweep.errors(case, track, 'with relaxation and body', TWO_HERTZ)
    assert gain < 0.01
    assert phase < np.radians(0.5)
    fixed, itself = linear_car(plant, 1.0), linear_car(steering, 1.0)
    assert itself.understeer > 1.2 * fixed.understeer


def test_form_at_rest_is_that_of_the_textbook(plant):
    car, V = linear_car(plant, 1.0), 25.0
    gain = yaw_rate_response(car, V, [0.0])[0]
    assert gain == pytest.approx(V / (car.wheelbase + car.understeer * V**2), rel=1e-12)
    assert car.steer(2.0, V) * gain.real * V == pytest.approx(2.0, rel=1e-12)


def test_relaxation_is_a_lag_and_short_tyres_have_none(plant):
    f_hz = np.array([0.1, 1.0, 2.0])
    stiff = replace(
        plant, car=replace(plant.car, wheel=replace(plant.car.wheel, lateral_stiffness_npm=1e12))
    )
    car = linear_car(plant, 1.0)
    with_lag, without = (yaw_rate_response(car, 20.0, f_hz, relaxation=on) for on in (True, False))
    short = yaw_rate_response(linear_car(stiff, 1.0), 20.0, f_hz)
    assert np.abs(short / without - 1).max() < 1e-5
    assert np.angle(with_lag[-1]) < np.angle(without[-1])


def test_a_body_that_cannot_move_leaves_the_single_track(plant):
    rigid = hung(plant, ride_rate_npm=1e12, camber_per_roll=0.0, static_camber_rad=0.0)
    wheel = replace(rigid.car.wheel, vertical_stiffness_npm=1e12, rolling_resistance=0.0)
    car = linear_car(replace(rigid, car=replace(rigid.car, wheel=wheel)), 1.0)
    f_hz = np.array([0.0, 0.5, 2.0])
    for relaxation in (True, False):
        body, plain = (yaw_rate_response(car, 20.0, f_hz, relaxation, b) for b in (True, False))
        assert np.abs(body / plain - 1).max() < 1e-6


def test_understeer_gradient_tends_to_the_closed_form(plant):
    """At a twentieth of g; up to 0.2 g the bend of the tyres adds 6 %."""
    given = settings.load()
    gentle = replace(given.steady_circle, fit_from_mps2=0.1, fit_to_mps2=0.5)
    case = procedure.Case(plant, 1.0, replace(given, steady_circle=gentle))
    runs = steady_circle.runs(case)
    numbers = steady_circle.numbers(case, runs, [procedure.drive(runs[0], case)])
    expected = numbers['understeer_gradient_with_body'].value
    assert numbers['understeer_gradient'].value == pytest.approx(expected, rel=0.03)
    # camber by roll and load transfer add to the understeer
    assert expected > numbers['understeer_gradient_single_track'].value > 0
