"""The controller's tyre from circular driving."""

import re
from dataclasses import replace

import numpy as np
import pytest

from msgs_yaml import share
from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, identify, parameters
from vehicle_plant.circular_driving import AxlePoints, CircleError, CircleParams


@pytest.fixture(scope='module')
def manoeuvre():
    return yaml_parameters.load(CircleParams, parameters.config_file('identify.yaml'))


@pytest.fixture(scope='module')
def track(params, manoeuvre):
    return circular_driving.drive(params, 1.0, manoeuvre)


def test_fit_finds_the_tyre_that_made_the_points(rng):
    alpha = np.linspace(-0.2, 0.05, 200)
    Fz = np.linspace(8000, 9000, 200)
    Fx = np.linspace(0, 2500, 200)
    blank = AxlePoints(alpha, Fx, np.zeros(200), Fz)
    Fy = identify.fiala_force(blank, 130e3, 0.93)
    exact = identify.fit_fiala(blank._replace(Fy=Fy))
    assert exact.cornering == pytest.approx(130e3, rel=1e-6)
    assert exact.friction == pytest.approx(0.93, rel=1e-6)
    noisy = identify.fit_fiala(blank._replace(Fy=Fy + rng.normal(0, 50, 200)))
    assert noisy.residual == pytest.approx(50, rel=0.15)
    assert abs(noisy.cornering - 130e3) < 2 * noisy.cornering_confidence
    assert abs(noisy.friction - 0.93) < 2 * noisy.friction_confidence


def test_car_reaches_nine_tenths_of_g_and_its_front_slides_first(track, params):
    ay = track.column('acceleration.ay') / 9.81
    assert 0.85 < ay.max() < 0.95
    front, rear = circular_driving.axle_points(track, params)
    assert abs(front.alpha[-1]) > 2 * abs(rear.alpha[-1])


def test_car_understeers_up_to_the_limit(track, params):
    """Steer beyond the geometric one grows with lateral acceleration all the way."""
    body = params.car.body
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    curvature = track.column('planar.r') / track.column('planar.vx')
    excess = track.column('servos.steer.position') - wheelbase * curvature
    ay = track.column('acceleration.ay')
    rising = ay < 0.98 * ay.max()
    gradient = np.diff(excess[rising]) / np.diff(ay[rising])
    assert (gradient[5:] > 0).all()
    per_g = np.degrees(9.81 * np.median(gradient[(ay[rising][1:] > 1) & (ay[rising][1:] < 4)]))
    assert 0.5 < per_g < 3.0


def test_axle_forces_make_the_lateral_acceleration(track, params):
    """Force balance over the record: quasi-steady, so tyres carry the centripetal force."""
    front, rear = circular_driving.axle_points(track, params)
    delta = track.column('servos.steer.position')
    Fy = front.Fy * np.cos(delta) + front.Fx * np.sin(delta) + rear.Fy
    vx, vy = track.column('planar.vx'), track.column('planar.vy')
    Fy -= (
        params.car.body.drag_area_m2 * params.car.body.air_density_kgpm3 / 2 * np.hypot(vx, vy) * vy
    )
    assert Fy == pytest.approx(params.car.body.mass_kg * track.column('acceleration.ay'), abs=1.0)


def test_residual_is_a_hundredth_of_the_axle_load(track, params):
    for axle in circular_driving.axle_points(track, params):
        values = identify.fit_fiala(axle)
        assert values.residual < 0.01 * axle.Fz.mean()
        assert values.cornering_confidence < 0.02 * values.cornering
        assert values.friction_confidence < 0.02 * values.friction


@pytest.mark.parametrize('friction', ['1.0', '0.5'])
@pytest.mark.parametrize('tyre', ['tyre_205_60r15.yaml', 'tyre_245_40r18.yaml'])
def test_same_plant_gives_the_same_files(tmp_path, tyre, friction):
    """Two tyres, two frictions: each file twice, bit by bit, and each another one."""
    for name in ('a', 'b'):
        given = ['--out', str(tmp_path / f'{name}.yaml'), '--tyre', tyre, '--friction', friction]
        assert identify.main(given) == 0
    assert (tmp_path / 'a.yaml').read_bytes() == (tmp_path / 'b.yaml').read_bytes()
    assert (tmp_path / 'a.png').read_bytes() == (tmp_path / 'b.png').read_bytes()
    values = yaml_parameters.read_file(tmp_path / 'a.yaml').values
    # a wide tyre is stiffer on any road; friction is that of the road, to a tenth
    stiff = values['tyre.front_cornering_npr'] > 160e3
    assert stiff == (tyre == 'tyre_245_40r18.yaml')
    assert values['tyre.front_friction'] == pytest.approx(float(friction), rel=0.1)


def test_both_manoeuvres_find_the_same_car(params, manoeuvre):
    """Constant speed and constant radius, ISO 4138: within 2 % of stiffness and friction."""
    fits = [
        [
            identify.fit_fiala(axle)
            for axle in circular_driving.axle_points(
                circular_driving.drive(params, 1.0, variant), params
            )
        ]
        for variant in (manoeuvre, replace(manoeuvre, manoeuvre='constant_radius'))
    ]
    for by_speed, by_radius in zip(*fits):
        assert by_radius.cornering == pytest.approx(by_speed.cornering, rel=0.02)
        assert by_radius.friction == pytest.approx(by_speed.friction, rel=0.02)


def test_radius_is_held_until_the_front_slides(params, manoeuvre):
    track = circular_driving.drive(params, 1.0, replace(manoeuvre, manoeuvre='constant_radius'))
    ay = track.column('acceleration.ay')
    radius = (track.column('planar.vx') / track.column('planar.r'))[(ay > 1.5) & (ay < 7.5)]
    assert np.abs(radius / manoeuvre.radius_m - 1).max() < 0.02


def test_files_note_how_they_were_made_and_the_result_is_shown_beside_the_one_before(
    tmp_path, capsys
):
    out = tmp_path / 'car.yaml'
    out.write_text('/**: {ros__parameters: {car: {mass_kg: 1500.0}}}')
    given = ['--car', 'vw_gti.yaml', '--manoeuvre', 'constant_radius', '--friction', '0.8']
    assert identify.main(['--out', str(out), *given]) == 0
    printed = capsys.readouterr().out
    rows = [line.split() for line in printed.splitlines()]
    assert ['car.yaml', 'value', 'before', 'unit,', 'meaning'] in rows
    assert ['car.mass_kg', '1868', '1500', 'kg'] in rows
    shown = {row[0] for row in rows if row}
    assert yaml_parameters.read_file(out).values.keys() <= shown
    assert f'--set plant.plant_params=vw_gti.yaml --set controller.car_file={out}' in printed
    text = out.read_text()
    command = 'identify --car vw_gti.yaml --manoeuvre constant_radius --friction 0.8 --out'
    assert command in text
    assert 'radius 60 m' in text
    assert 'mass_kg: 1868.0' in text
    assert 'systematic' in text


@pytest.mark.parametrize(
    ('car', 'share_', 'steer_rate'), [('vw_gti.yaml', 1.0, 0.349), ('bmw_545i.yaml', 0.0, 0.8)]
)
def test_the_file_says_which_axle_is_driven_and_what_the_actuators_can_do(
    tmp_path, car, share_, steer_rate
):
    out = tmp_path / 'car.yaml'
    assert identify.main(['--out', str(out), '--car', car]) == 0
    values = yaml_parameters.read_file(out).values
    force = parameters.load(parameters.config_file(car)).car.force
    assert values['actuators.drive_front_share'] == share_
    assert values['actuators.steer_rate_radps'] == steer_rate
    assert values['actuators.brake_n'] == force.front.brake_n + force.rear.brake_n
    assert values['actuators.drive_n'] == force.front.drive_n + force.rear.drive_n


@pytest.mark.parametrize('friction', ['0', '0.01', '2', 'nan'])
def test_a_friction_that_no_road_has_is_refused_with_the_range(tmp_path, capsys, friction):
    with pytest.raises(SystemExit) as exit_:
        identify.main(['--out', str(tmp_path / 'car.yaml'), '--friction', friction])
    assert exit_.value.code == 2
    assert '--friction: is ' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('option', 'known'),
    [
        ('--car', 'bmw_320i.yaml, bmw_330i.yaml, bmw_545i.yaml, commonroad_320i.yaml, vw_gti.yaml'),
        ('--tyre', 'tyre_205_60r15.yaml, tyre_245_40r18.yaml, tyre_320i.yaml, tyre_book.yaml'),
    ],
)
def test_a_file_that_is_not_there_is_named_with_its_option_and_those_there_are(
    tmp_path, capsys, option, known
):
    with pytest.raises(SystemExit) as exit_:
        identify.main(['--out', str(tmp_path / 'car.yaml'), option, 'nobody.yaml'])
    assert exit_.value.code == 1
    error = capsys.readouterr().err
    assert error.startswith(f'identify: {option}: ')
    assert f'no file config/nobody.yaml; it has {known}; ' in error


def test_controller_uses_what_this_plant_gives(tmp_path):
    """The committed file is not older than the plant."""
    identify.main(['--out', str(tmp_path / 'car.yaml')])
    fresh = yaml_parameters.read_file(tmp_path / 'car.yaml').values
    used = yaml_parameters.read_file(share.path('mpcc_controller', 'config', 'car.yaml')).values
    assert fresh == pytest.approx(used, rel=1e-4)


def test_less_friction_is_found_as_such(params, manoeuvre):
    track = circular_driving.drive(params, 0.5, manoeuvre)
    for axle in circular_driving.axle_points(track, params):
        assert identify.fit_fiala(axle).friction == pytest.approx(0.5, abs=0.05)


def test_manoeuvre_that_does_not_end_is_an_error(params, manoeuvre):
    with pytest.raises(CircleError, match='front slip'):
        circular_driving.drive(params, 1.0, replace(manoeuvre, longest_s=5.0))


def test_an_earlier_file_may_hold_anything(tmp_path, capsys):
    out = tmp_path / 'car.yaml'
    out.write_text('/**: {ros__parameters: {car: {mass_kg: abc, yaw_inertia_kgm2: }}}\n')
    assert identify.main(['--out', str(out)]) == 0
    table = capsys.readouterr().out
    assert re.search(r'car.mass_kg +1850 +abc +kg', table)
    assert 'Drive with it' in table
