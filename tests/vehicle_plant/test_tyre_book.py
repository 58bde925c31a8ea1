"""The tyre against the book, written down a second time in plain numpy, equation by equation.

Source: H. B. Pacejka, Tire and Vehicle Dynamics, 3rd edition, 2012, section 4.3.2, steady state,
no turn slip (zeta = 1), forward rolling. The numbers in the comments are those of the equations.
Nothing here comes from the plant but the coefficients.
"""

from dataclasses import fields, replace
from math import atan, cos, exp, sin

import numpy as np
import pytest

from vehicle_plant import parameters, tyre
from vehicle_plant.tyre import Contact
from vehicle_plant.tyre_coefficients import TyreCoefficients, TyreScaling

SETS = ('tyre_205_60r15.yaml', 'tyre_book.yaml', 'tyre_245_40r18.yaml')
ONES = TyreScaling(**dict.fromkeys((f.name for f in fields(TyreScaling)), 1.0))
# Fz [N], kappa [-], alpha [rad], gamma [rad], pressure [Pa]
PURE = [
    (4000.0, 0.0, 0.0, 0.0, 220e3),
    (2500.0, 0.02, 0.0, 0.0, 220e3),
    (4500.0, -0.14, 0.0, 0.0, 220e3),
    (6500.0, 0.9, 0.0, 0.0, 220e3),
    (1200.0, -0.05, 0.0, -0.05, 220e3),
    (2500.0, 0.0, 0.02, 0.0, 220e3),
    (4500.0, 0.0, -0.16, 0.0, 220e3),
    (6500.0, 0.0, 0.5, 0.0, 220e3),
    (3000.0, 0.0, 0.07, 0.06, 220e3),
    (8000.0, 0.0, -0.04, 0.06, 220e3),
    (5000.0, 0.0, 0.0, -0.07, 220e3),
    (4000.0, 0.0, 0.1, 0.02, 180e3),
]
COMBINED = [
    (4000.0, 0.05, 0.05, 0.0, 220e3),
    (4000.0, -0.05, 0.05, 0.0, 220e3),
    (4000.0, 0.05, -0.05, 0.0, 220e3),
    (2500.0, -0.12, -0.1, 0.03, 220e3),
    (6500.0, 0.3, 0.2, -0.03, 220e3),
    (800.0, -1.0, 0.4, 0.0, 220e3),
    (5500.0, 0.015, -0.3, 0.05, 220e3),
    (3500.0, -0.5, 0.015, -0.05, 220e3),
    (7500.0, 0.1, 0.12, 0.02, 250e3),
    (4500.0, -0.02, 0.02, 0.07, 200e3),
]


def magic(B, C, E, x):
    return C * atan(B * x - E * (B * x - atan(B * x)))


def sign(x):
    return float(np.sign(x))


def book(Fz, kappa, alpha, gamma, p_i, c, L):
    """Return (Fx, Fy, Fx0, Fy0); c: coefficients by name, L: scaling factors by name."""
    Fz0 = L['LFZO'] * c['FNOMIN']  # 4.E1
    dfz = (Fz - Fz0) / Fz0  # 4.E2a
    dpi = (p_i - c['NOMPRES']) / c['NOMPRES']  # 4.E2b
    a = np.tan(alpha)  # 4.E3
    g = sin(gamma)  # 4.E4

    # longitudinal force, pure slip
    SHx = (c['PHX1'] + c['PHX2'] * dfz) * L['LHX']  # 4.E17
    kx = kappa + SHx  # 4.E10
    Cx = c['PCX1'] * L['LCX']  # 4.E11
    mux = (c['PDX1'] + c['PDX2'] * dfz) * (1 + c['PPX3'] * dpi + c['PPX4'] * dpi**2)
    mux *= (1 - c['PDX3'] * gamma**2) * L['LMUX']  # 4.E13
    Dx = mux * Fz  # 4.E12
    Ex = (c['PEX1'] + c['PEX2'] * dfz + c['PEX3'] * dfz**2) * (1 - c['PEX4'] * sign(kx))
    Ex = min(Ex * L['LEX'], 1)  # 4.E14
    Kxk = Fz * (c['PKX1'] + c['PKX2'] * dfz) * exp(c['PKX3'] * dfz)
    Kxk *= (1 + c['PPX1'] * dpi + c['PPX2'] * dpi**2) * L['LKX']  # 4.E15
    Bx = Kxk / (Cx * Dx)  # 4.E16
    SVx = Fz * (c['PVX1'] + c['PVX2'] * dfz) * L['LVX'] * L['LMUX']  # 4.E18
    Fx0 = Dx * sin(magic(Bx, Cx, Ex, kx)) + SVx  # 4.E9

    # lateral force, pure slip
    Kya = c['PKY1'] * Fz0 * (1 + c['PPY1'] * dpi) * (1 - c['PKY3'] * abs(g))
    peak = (c['PKY2'] + c['PKY5'] * g**2) * (1 + c['PPY2'] * dpi)
    Kya *= sin(c['PKY4'] * atan(Fz / Fz0 / peak)) * L['LKY']  # 4.E25
    SVyg = Fz * (c['PVY3'] + c['PVY4'] * dfz) * g * L['LKYC'] * L['LMUY']  # 4.E28
    Kyg0 = Fz * (c['PKY6'] + c['PKY7'] * dfz) * (1 + c['PPY5'] * dpi) * L['LKYC']  # 4.E30
    SHy = (c['PHY1'] + c['PHY2'] * dfz) * L['LHY']  # 4.E27 without camber
    SHy += (Kyg0 * g - c['SHY3'] * SVyg) / Kya  # 4.E27 at 1; Magic Formula 5.2: 0, and Kyg0 is 0
    SHy += c['PHY3'] * g * L['LKYC']  # Magic Formula 5.2: shift with camber
    ay = a + SHy  # 4.E20
    Cy = c['PCY1'] * L['LCY']  # 4.E21
    muy = (c['PDY1'] + c['PDY2'] * dfz) * (1 + c['PPY3'] * dpi + c['PPY4'] * dpi**2)
    muy *= (1 - c['PDY3'] * g**2) * L['LMUY']  # 4.E23
    Dy = muy * Fz  # 4.E22
    Ey = c['PEY1'] + c['PEY2'] * dfz
    Ey *= 1 + c['PEY5'] * g**2 - (c['PEY3'] + c['PEY4'] * g) * sign(ay)
    Ey = min(Ey * L['LEY'], 1)  # 4.E24
    By = Kya / (Cy * Dy)  # 4.E26
    SVy = Fz * (c['PVY1'] + c['PVY2'] * dfz) * L['LVY'] * L['LMUY'] + SVyg  # 4.E29
    Fy0 = Dy * sin(magic(By, Cy, Ey, ay)) + SVy  # 4.E19

    # combined slip
    SHxa = c['RHX1']  # 4.E57
    Exa = min(c['REX1'] + c['REX2'] * dfz, 1)  # 4.E56
    Bxa = (c['RBX1'] + c['RBX3'] * g**2) * cos(atan(c['RBX2'] * kappa)) * L['LXAL']  # 4.E54
    Gxa0 = cos(magic(Bxa, c['RCX1'], Exa, SHxa))  # 4.E52
    Gxa = cos(magic(Bxa, c['RCX1'], Exa, a + SHxa)) / Gxa0  # 4.E51, 4.E53
    SHyk = c['RHY1'] + c['RHY2'] * dfz  # 4.E65
    Eyk = min(c['REY1'] + c['REY2'] * dfz, 1)  # 4.E64
    Byk = (c['RBY1'] + c['RBY4'] * g**2) * cos(atan(c['RBY2'] * (a - c['RBY3'])))
    Byk *= L['LYKA']  # 4.E62
    Gyk0 = cos(magic(Byk, c['RCY1'], Eyk, SHyk))  # 4.E60
    Gyk = cos(magic(Byk, c['RCY1'], Eyk, kappa + SHyk)) / Gyk0  # 4.E59, 4.E61
    DVyk = muy * Fz * (c['RVY1'] + c['RVY2'] * dfz + c['RVY3'] * g)
    DVyk *= cos(atan(c['RVY4'] * a))  # 4.E67
    SVyk = DVyk * sin(c['RVY5'] * atan(c['RVY6'] * kappa)) * L['LVYKA']  # 4.E66
    return Gxa * Fx0, Gyk * Fy0 + SVyk, Fx0, Fy0  # 4.E50, 4.E58


def by_name(of):
    return {f.name: getattr(of, f.name) for f in fields(of)}


def coefficients(tyre_set):
    merged = {}
    for group in by_name(tyre_set).values():
        merged |= by_name(group)
    return merged


@pytest.fixture(scope='module')
def all_terms():
    """A tyre that no coefficient leaves out: the 245/40R18, every zero replaced."""
    rng = np.random.default_rng(7)
    published = parameters.load_tyre('tyre_245_40r18.yaml')
    groups = {}
    for f in fields(TyreCoefficients):
        group = getattr(published, f.name)
        small = {k: rng.uniform(0.02, 0.2) for k, v in by_name(group).items() if v == 0.0}
        groups[f.name] = replace(group, **small)
    return TyreCoefficients(**groups)


def assert_equal(point, tyre_set, scaling):
    Fz, kappa, alpha, gamma, pressure = point
    force = tyre.force(Contact(Fz, kappa, np.tan(alpha), gamma, 1.0, pressure), tyre_set, scaling)
    Fx, Fy, _, _ = book(*point, coefficients(tyre_set), by_name(scaling))
    assert force.Fx == pytest.approx(Fx, rel=1e-9, abs=1e-6)
    assert force.Fy == pytest.approx(Fy, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize('name', SETS)
@pytest.mark.parametrize('point', PURE + COMBINED)
def test_published_tyres_give_the_force_of_the_book(name, point):
    assert_equal(point, parameters.load_tyre(name), ONES)


@pytest.mark.parametrize('point', PURE + COMBINED)
def test_every_term_of_the_book_is_there(all_terms, point):
    assert_equal(point, all_terms, ONES)


@pytest.mark.parametrize('point', PURE)
def test_every_scaling_factor_of_pure_slip_does_what_the_book_says(all_terms, point):
    """In combined slip the plant departs from the book: it also scales the slip (`_similar`)."""
    rng = np.random.default_rng(3)
    scaling = TyreScaling(**{name: rng.uniform(0.7, 1.4) for name in by_name(ONES)})
    Fz, kappa, alpha, gamma, pressure = point
    c = Contact(Fz, kappa, np.tan(alpha), gamma, 1.0, pressure)
    force = tyre.force(c, all_terms, scaling)
    _, _, Fx0, Fy0 = book(*point, coefficients(all_terms), by_name(scaling))
    if alpha == 0.0:  # no loss by side slip
        assert force.Fx == pytest.approx(Fx0, rel=1e-9)
    if kappa == 0.0:
        assert force.Fy == pytest.approx(Fy0, rel=1e-9)
