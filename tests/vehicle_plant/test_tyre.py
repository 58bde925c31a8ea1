"""The Magic Formula against published numbers, and against itself."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from vehicle_plant import parameters, tyre
from vehicle_plant.tyre import Contact

PRESSURE = 220e3


def contact(Fz, kappa=0.0, tan_alpha=0.0, gamma=0.0, friction=1.0):
    return Contact(Fz, kappa, tan_alpha, gamma, friction, PRESSURE)


@pytest.fixture(scope='module')
def forces(params):
    """Forces of many contacts at once, for a scaling."""

    def evaluate(columns, scaling, tyre_set=params.tyre):
        symbols = [ca.SX.sym(name) for name in Contact._fields]
        F = tyre.force(Contact(*symbols), tyre_set, scaling)
        return np.array(ca.Function('F', symbols, [ca.vertcat(*F)]).map(columns.shape[1])(*columns))

    return evaluate


@pytest.mark.parametrize(
    ('name', 'Fz', 'Ky', 'right', 'left', 'braking'),
    [
        ('tyre_205_60r15.yaml', 2500.0, 32.3e3, 1.098, 0.990, 1.224),
        ('tyre_205_60r15.yaml', 4500.0, 49.4e3, 1.014, 0.930, 1.205),
        ('tyre_205_60r15.yaml', 6500.0, 57.7e3, 0.929, 0.869, 1.187),
        ('tyre_book.yaml', 2500.0, 34.2e3, 1.019, 1.019, 1.037),
        ('tyre_book.yaml', 6500.0, 58.7e3, 0.969, 0.969, 0.937),
        ('tyre_245_40r18.yaml', 2500.0, 49.7e3, 1.155, 1.074, 1.234),
        ('tyre_245_40r18.yaml', 6500.0, 84.6e3, 0.962, 0.900, 1.067),
    ],
)
def test_stiffness_and_peaks_fall_with_load_as_published(
    bare, forces, name, Fz, Ky, right, left, braking
):
    tyre_set = parameters.load_tyre(name)
    assert -tyre.stiffness(contact(Fz), tyre_set, bare).Ky == pytest.approx(Ky, rel=2e-3)
    slip = np.linspace(-0.6, 0.6, 2401)
    rest, ones = np.zeros_like(slip), np.ones_like(slip)
    pressure = PRESSURE * ones
    side = forces(np.array([Fz * ones, rest, slip, rest, ones, pressure]), bare, tyre_set)[1] / Fz
    along = forces(np.array([Fz * ones, slip, rest, rest, ones, pressure]), bare, tyre_set)[0] / Fz
    assert side.max() == pytest.approx(right, abs=2e-3)
    assert -side.min() == pytest.approx(left, abs=2e-3)
    assert -along.min() == pytest.approx(braking, abs=8e-3)


def friction_use(tyre_set, scaling, forces, rng, n=100_000):
    """Return the force over the ellipse of the peaks of pure slip at its load, (n,)."""
    Fz = rng.uniform(300.0, 9000.0, n)
    friction = rng.uniform(0.3, 1.1, n)
    kappa, tan_alpha = rng.uniform(-1.5, 1.5, n), rng.uniform(-1.5, 1.5, n)
    near = rng.random(n) < 0.5
    kappa[near] *= 0.15
    tan_alpha[near] *= 0.2
    columns = np.array([Fz, kappa, tan_alpha, 0 * Fz, friction, np.full(n, PRESSURE)])
    Fx, Fy = forces(columns, scaling, tyre_set)
    y, x = tyre_set.lateral, tyre_set.longitudinal
    dfz = Fz / tyre_set.reference.FNOMIN - 1
    mu_x = (x.PDX1 + x.PDX2 * dfz) * scaling.LMUX * friction
    mu_y = np.abs(y.PDY1 + y.PDY2 * dfz) * scaling.LMUY * friction
    return np.hypot(Fx / (mu_x * Fz), Fy / (mu_y * Fz))


@pytest.mark.parametrize('axle', ['front', 'rear'])
def test_force_stays_within_the_friction_ellipse(params, forces, rng, axle):
    use = friction_use(params.tyre, getattr(params.car.scaling, axle), forces, rng)
    assert 0.95 < use.max() < 1.06


def test_published_tyre_stays_within_the_friction_ellipse(params, bare, forces, rng):
    """With its shifts, which belong to the one tyre that was measured."""
    assert 0.95 < friction_use(params.tyre, bare, forces, rng).max() < 1.06


@pytest.mark.parametrize(
    ('name', 'most'), [('tyre_book.yaml', 1.13), ('tyre_245_40r18.yaml', 1.11)]
)
def test_rounder_tyres_pass_the_ellipse_by_little(params, forces, rng, name, most):
    """Their published weightings give more than an ellipse where both slips are used."""
    use = friction_use(parameters.load_tyre(name), params.car.scaling.front, forces, rng)
    assert np.percentile(use, 95) < 1.06
    assert 1.06 < use.max() < most


def test_slopes_at_zero_slip_are_the_stiffnesses(params):
    for Fz in (800.0, 3000.0, 4500.0, 8000.0):
        scaling = replace(params.car.scaling.front)
        slope = tyre.stiffness(contact(Fz), params.tyre, scaling)
        h = 1e-6
        along = [tyre.force(contact(Fz, kappa=s * h), params.tyre, scaling).Fx for s in (-1, 1)]
        side = [tyre.force(contact(Fz, tan_alpha=s * h), params.tyre, scaling).Fy for s in (-1, 1)]
        # the shift RHX1, RHY1 of the weighting leaves the slope at zero slip as it is
        assert (along[1] - along[0]) / (2 * h) == pytest.approx(slope.Kx, rel=1e-3)
        assert (side[1] - side[0]) / (2 * h) == pytest.approx(slope.Ky, rel=1e-3)


@pytest.mark.parametrize('name', ['tyre_205_60r15.yaml', 'tyre_book.yaml', 'tyre_245_40r18.yaml'])
def test_symbolic_derivatives_equal_finite_differences(params, rng, name):
    """To 1e-6 of the slope: central differences of fourth order, away from the kinks at zero."""
    symbols = [ca.SX.sym(name) for name in Contact._fields]
    F = ca.vertcat(
        *tyre.force(Contact(*symbols), parameters.load_tyre(name), params.car.scaling.front)
    )
    inner = ca.vertcat(*symbols[:4])
    f = ca.Function('f', symbols, [F, ca.jacobian(F, inner)])
    steps = (1.0, 1e-4, 1e-4, 1e-4)
    for _ in range(50):
        at = [rng.uniform(500, 8000), *rng.uniform(0.01, 0.3, 2), rng.uniform(0.01, 0.1), 1.0]
        at.append(PRESSURE)
        slopes = np.array(f(*at)[1])
        for i, h in enumerate(steps):
            m2, m1, p1, p2 = (
                np.array(f(*at[:i], at[i] + s * h, *at[i + 1 :])[0]) for s in (-2, -1, 1, 2)
            )
            difference = (8 * (p1 - m1) - (p2 - m2)) / (12 * h)
            scale = np.abs(slopes[:, [i]]).max()
            assert np.abs(difference - slopes[:, [i]]).max() <= 1e-6 * scale


def test_camber_pushes_to_the_side_it_leans(params):
    F = tyre.force(contact(4500.0, gamma=0.05), params.tyre, params.car.scaling.front)
    assert F.Fy < -100.0


def test_right_hand_tyre_is_the_mirror_image(params, bare):
    c = contact(4000.0, kappa=0.03, tan_alpha=0.05, gamma=0.02)
    left = tyre.force(c, params.tyre, bare)
    right = tyre.mirrored_force(c._replace(tan_alpha=-0.05, gamma=-0.02), params.tyre, bare)
    assert right == (left.Fx, -left.Fy)


def test_friction_scales_the_peak_and_leaves_the_stiffness(params):
    scaling = params.car.scaling.front
    wet = contact(4500.0, tan_alpha=0.3, friction=0.5)
    dry = contact(4500.0, tan_alpha=0.3)
    ratio = tyre.force(wet, params.tyre, scaling).Fy / tyre.force(dry, params.tyre, scaling).Fy
    assert ratio == pytest.approx(0.5, abs=0.05)
    assert tyre.stiffness(wet, params.tyre, scaling) == tyre.stiffness(dry, params.tyre, scaling)
