"""The controller's tyre from circular driving."""

import contextlib
import io
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from drives import altered, circle, circle_params, load
from installation import ROOT

from msgs_yaml import share
from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, identify
from vehicle_plant.circular_driving import AxlePoints, CircleError

COMMANDS = re.findall(
    r'^identify (.*?)(?=\s*#|$)', (ROOT / 'docs/plant.md').read_text(), flags=re.MULTILINE
)


def fits(driven):
    return [identify.fit_fiala(axle) for axle in circular_driving.axle_points(driven, load())]


def test_fit_finds_the_tyre_that_made_the_points(rng):
    alpha = np.linspace(-0.2, 0.05, 200)
    Fz, Fx = np.linspace(8000, 9000, 200), np.linspace(0, 2500, 200)
    blank = AxlePoints(alpha, Fx, np.zeros(200), Fz)
    Fy = identify.fiala_force(blank, 130e3, 0.93)
    exact = identify.fit_fiala(blank._replace(Fy=Fy))
    assert (exact.cornering, exact.friction) == pytest.approx((130e3, 0.93), rel=1e-6)
    noisy = identify.fit_fiala(blank._replace(Fy=Fy + rng.normal(0, 50, 200)))
    assert noisy.residual == pytest.approx(50, rel=0.15)
    assert 0 < abs(noisy.cornering - 130e3) < 2 * noisy.cornering_confidence < 0.1 * 130e3
    assert 0 < abs(noisy.friction - 0.93) < 2 * noisy.friction_confidence < 0.1


def test_axle_forces_make_the_lateral_acceleration(params):
    """Force balance over the record: quasi-steady, so tyres carry the centripetal force."""
    driven, body = circle(), params.car.body
    front, rear = circular_driving.axle_points(driven, params)
    delta = driven.column('servos.steer.position')
    Fy = front.Fy * np.cos(delta) + front.Fx * np.sin(delta) + rear.Fy
    vx, vy = driven.column('planar.vx'), driven.column('planar.vy')
    Fy -= body.drag_area_m2 * body.air_density_kgpm3 / 2 * np.hypot(vx, vy) * vy
    assert Fy == pytest.approx(body.mass_kg * driven.column('acceleration.ay'), abs=1.0)
    weight = body.mass_kg * body.gravity_mps2
    assert front.Fz + rear.Fz == pytest.approx(np.full_like(vx, weight), rel=1e-3)


def test_both_manoeuvres_find_the_same_car():
    """Constant speed and constant radius, ISO 4138: within 2 % of stiffness and friction."""
    for by_speed, by_radius, axle in zip(
        fits(circle()),
        fits(circle(manoeuvre='constant_radius')),
        circular_driving.axle_points(circle(), load()),
    ):
        assert by_radius.cornering == pytest.approx(by_speed.cornering, rel=0.02)
        assert by_radius.friction == pytest.approx(by_speed.friction, rel=0.02)
        assert by_speed.residual < 0.01 * axle.Fz.mean()
        assert by_speed.cornering_confidence < 0.02 * by_speed.cornering
        assert by_speed.friction_confidence < 0.02 * by_speed.friction


def test_less_friction_is_found_as_such():
    for fit in fits(circle(friction=0.5)):
        assert fit.friction == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ('changes', 'settings', 'message'),
    [
        ({}, {'longest_s': 5.0}, r'front slip 0\.\d+ rad after 5\.0 s'),
        ({'car__force__rear__drive_n': 0.0}, {}, 'no engine: force.front.drive_n and'),
        ({'car__gate__steer_rate_radps': 0.001}, {}, 'refuses the command: steer step'),
    ],
)
def test_a_manoeuvre_that_does_not_reach_its_end_is_an_error(params, changes, settings, message):
    with pytest.raises(CircleError, match=message):
        circular_driving.drive(altered(params, **changes), 1.0, circle_params(**settings))


@pytest.fixture(scope='module')
def by_manual(tmp_path_factory):
    """What the commands of the manual leave and print, by the file that they write."""
    results = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp('manual'))
        for command in COMMANDS:
            option, name, *_ = arguments = shlex.split(command)
            # an earlier file may hold anything
            earlier = '/**: {ros__parameters: {car: {mass_kg: 1500.0, yaw_inertia_kgm2: abc}}}'
            Path(name).write_text(earlier)
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                assert (option, identify.main(arguments)) == ('--out', 0)
            results[name] = Path(name).absolute(), printed.getvalue()
    return results


def test_the_manual_has_three_commands_that_leave_a_file_and_a_picture(by_manual):
    assert len(by_manual) == 3
    for path, _ in by_manual.values():
        assert path.is_file()
        assert path.with_suffix('.png').is_file()


def test_controller_uses_what_this_plant_gives_every_time_bit_by_bit(by_manual, tmp_path):
    """The committed file is not older than the plant."""
    first, _ = by_manual['car.yaml']
    again = tmp_path / 'car.yaml'
    assert identify.main(['--out', str(again)]) == 0
    for suffix in ('.yaml', '.png'):
        assert first.with_suffix(suffix).read_bytes() == again.with_suffix(suffix).read_bytes()
    fresh = yaml_parameters.read_file(first).values
    used = yaml_parameters.read_file(share.path('mpcc_controller', 'config', 'car.yaml')).values
    assert fresh == pytest.approx(used, rel=1e-4)


def test_files_note_how_they_were_made_and_the_result_is_shown_beside_the_one_before(by_manual):
    """The GTI is driven at the front and steers slowly."""
    out, printed = by_manual['gti.yaml']
    rows = [line.split() for line in printed.splitlines()]
    assert ['gti.yaml', 'value', 'before', 'unit,', 'meaning'] in rows
    assert ['car.mass_kg', '1868', '1500', 'kg'] in rows
    assert ['car.yaw_inertia_kgm2', '3049', 'abc', 'kg', 'm^2'] in rows
    values, force = yaml_parameters.read_file(out).values, load('vw_gti.yaml').car.force
    assert values.keys() <= {row[0] for row in rows if row}
    assert '--set plant.plant_params=vw_gti.yaml --set controller.car_file=./gti.yaml' in printed
    text = out.read_text()
    assert 'identify --car vw_gti.yaml --manoeuvre constant_radius --friction 1 --out' in text
    assert 'radius 60 m' in text
    assert 'systematic' in text
    expected = {
        'drive_front_share': 1.0,
        'steer_rate_radps': 0.349,
        'brake_n': force.front.brake_n + force.rear.brake_n,
        'drive_n': force.front.drive_n + force.rear.drive_n,
    }
    assert {name: values[f'actuators.{name}'] for name in expected} == expected


CARS = (
    'bmw_320i.yaml, bmw_330i.yaml, bmw_545i.yaml, commonroad_320i.yaml, volvo_v40.yaml, vw_gti.yaml'
)
TYRES = 'tyre_205_60r15.yaml, tyre_245_40r18.yaml, tyre_320i.yaml, tyre_book.yaml'


@pytest.mark.parametrize(
    ('option', 'value', 'code', 'error'),
    [
        *(('--friction', value, 2, '--friction: is ') for value in ('0', '0.01', '2', 'nan')),
        ('--car', 'nobody.yaml', 1, f'no file config/nobody.yaml; it has {CARS}; '),
        ('--tyre', 'nobody.yaml', 1, f'no file config/nobody.yaml; it has {TYRES}; '),
    ],
)
def test_a_mistake_is_named_with_its_option(tmp_path, capsys, option, value, code, error):
    with pytest.raises(SystemExit) as ended:
        identify.main(['--out', str(tmp_path / 'car.yaml'), option, value])
    assert ended.value.code == code
    printed = capsys.readouterr().err
    assert f'{option}: ' in printed
    assert error in printed
