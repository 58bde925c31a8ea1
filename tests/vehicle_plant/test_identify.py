"""The controller's tyre from circular driving."""

import numpy as np
import pytest

from msgs_yaml import parameters as yaml_parameters
from msgs_yaml import share
from vehicle_plant import circle, fiala_fit, identify, parameters
from vehicle_plant.circle import AxlePoints, Circle, CircleError


@pytest.fixture(scope='module')
def manoeuvre():
    return yaml_parameters.load(Circle, parameters.config('identify.yaml'))


@pytest.fixture(scope='module')
def track(params, manoeuvre):
    return circle.drive(params, 1.0, manoeuvre)


def test_fit_finds_the_tyre_that_made_the_points(rng):
    alpha = np.linspace(-0.2, 0.05, 200)
    Fz = np.linspace(8000, 9000, 200)
    Fx = np.linspace(0, 2500, 200)
    blank = AxlePoints(alpha, Fx, np.zeros(200), Fz)
    Fy = fiala_fit.force(blank, 130e3, 0.93)
    exact = fiala_fit.fit(blank._replace(Fy=Fy))
    assert exact.cornering == pytest.approx(130e3, rel=1e-6)
    assert exact.friction == pytest.approx(0.93, rel=1e-6)
    noisy = fiala_fit.fit(blank._replace(Fy=Fy + rng.normal(0, 50, 200)))
    assert noisy.residual == pytest.approx(50, rel=0.15)
    assert abs(noisy.cornering - 130e3) < 2 * noisy.cornering_confidence
    assert abs(noisy.friction - 0.93) < 2 * noisy.friction_confidence


def test_car_reaches_nine_tenths_of_g_and_its_front_slides_first(track, params):
    ay = track.column('acceleration.ay') / 9.81
    assert 0.85 < ay.max() < 0.95
    front, rear = circle.axles(track, params)
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
    front, rear = circle.axles(track, params)
    delta = track.column('servos.steer.position')
    Fy = front.Fy * np.cos(delta) + front.Fx * np.sin(delta) + rear.Fy
    vx, vy = track.column('planar.vx'), track.column('planar.vy')
    Fy -= (
        params.car.body.drag_area_m2 * params.car.body.air_density_kgpm3 / 2 * np.hypot(vx, vy) * vy
    )
    assert Fy == pytest.approx(params.car.body.mass_kg * track.column('acceleration.ay'), abs=1.0)


def test_residual_is_a_hundredth_of_the_axle_load(track, params):
    for axle in circle.axles(track, params):
        found = fiala_fit.fit(axle)
        assert found.residual < 0.01 * axle.Fz.mean()
        assert found.cornering_confidence < 0.02 * found.cornering
        assert found.friction_confidence < 0.02 * found.friction


def test_same_plant_gives_the_same_files(tmp_path):
    for name in ('a', 'b'):
        assert identify.main(['--out', str(tmp_path / f'{name}.yaml')]) == 0
    assert (tmp_path / 'a.yaml').read_bytes() == (tmp_path / 'b.yaml').read_bytes()
    assert (tmp_path / 'a.png').read_bytes() == (tmp_path / 'b.png').read_bytes()


def test_controller_uses_what_this_plant_gives(tmp_path):
    """The committed file is not older than the plant."""
    identify.main(['--out', str(tmp_path / 'car.yaml')])
    fresh, _ = yaml_parameters.read_file(tmp_path / 'car.yaml')
    used, _ = yaml_parameters.read_file(share.path('mpcc_controller', 'config', 'car.yaml'))
    assert fresh == pytest.approx(used, rel=1e-4)


def test_less_friction_is_found_as_such(params, manoeuvre):
    track = circle.drive(params, 0.5, manoeuvre)
    for axle in circle.axles(track, params):
        assert fiala_fit.fit(axle).friction == pytest.approx(0.5, abs=0.05)


def test_manoeuvre_that_does_not_end_is_an_error(params, manoeuvre):
    from dataclasses import replace

    with pytest.raises(CircleError, match='front slip'):
        circle.drive(params, 1.0, replace(manoeuvre, longest_s=5.0))
