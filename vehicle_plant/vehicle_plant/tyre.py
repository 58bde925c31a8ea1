"""Tyre forces by the Magic Formula 6.1, combined slip: Pacejka 2012, section 4.3.2, (4.E1)-(4.E78).

ISO axes of the wheel: x forward, y left, camber gamma positive about x, alpha positive when the
contact patch moves to the left. kappa [-], tan(alpha) [-], gamma [rad], Fz and forces [N].
Not modelled: aligning and overturning moments, turn slip. Works on numbers and on CasADi symbols.
"""

from typing import Any, NamedTuple

import casadi as ca

from vehicle_plant.tyre_coefficients import TyreCoefficients, TyreScaling


class Contact(NamedTuple):
    """Inputs of the tyre; the slips are the transient ones in unsteady rolling."""

    Fz: Any  # N, > 0
    kappa: Any  # -
    tan_alpha: Any  # -, Vy / |Vx|
    gamma: Any  # rad
    friction: Any  # -, of the road, relative to the test surface
    pressure: Any  # Pa


class Force(NamedTuple):
    """Force of the road on the tyre, wheel axes."""

    Fx: Any  # N
    Fy: Any  # N


class Stiffness(NamedTuple):
    """Slopes at zero slip."""

    Kx: Any  # N per unit of kappa, positive
    Ky: Any  # N/rad, negative in ISO axes


def _magic(B, C, E, x):
    """Return the angle inside the Magic Formula's sine or cosine."""
    return C * ca.atan(B * x - E * (B * x - ca.atan(B * x)))


def _cos_atan(x):
    return 1 / ca.sqrt(1 + x**2)


def _load_excess(c: Contact, t: TyreCoefficients, s: TyreScaling):
    nominal = s.LFZO * t.reference.FNOMIN
    return nominal, (c.Fz - nominal) / nominal


def _pressure_excess(c: Contact, t: TyreCoefficients):
    return (c.pressure - t.reference.NOMPRES) / t.reference.NOMPRES


def stiffness(c: Contact, t: TyreCoefficients, s: TyreScaling) -> Stiffness:
    """Return longitudinal slip stiffness (4.E15) and cornering stiffness (4.E25)."""
    x, y = t.longitudinal, t.lateral
    nominal, dfz = _load_excess(c, t, s)
    dpi = _pressure_excess(c, t)
    camber = ca.sin(c.gamma)
    Kx = c.Fz * (x.PKX1 + x.PKX2 * dfz) * ca.exp(x.PKX3 * dfz)
    Kx *= (1 + x.PPX1 * dpi + x.PPX2 * dpi**2) * s.LKX
    load_of_peak = nominal * (y.PKY2 + y.PKY5 * camber**2) * (1 + y.PPY2 * dpi)
    Ky = y.PKY1 * nominal * (1 + y.PPY1 * dpi) * (1 - y.PKY3 * ca.fabs(camber))
    Ky *= ca.sin(y.PKY4 * ca.atan(c.Fz / load_of_peak)) * s.LKY
    return Stiffness(Kx, Ky)


def _pure_longitudinal(c, t, s, Kx):
    """Return Fx0 (4.E9)."""
    x = t.longitudinal
    _, dfz = _load_excess(c, t, s)
    dpi = _pressure_excess(c, t)
    kappa = c.kappa + (x.PHX1 + x.PHX2 * dfz) * s.LHX
    mu = (x.PDX1 + x.PDX2 * dfz) * (1 + x.PPX3 * dpi + x.PPX4 * dpi**2)
    mu *= (1 - x.PDX3 * c.gamma**2) * s.LMUX * c.friction
    C = x.PCX1 * s.LCX
    D = mu * c.Fz
    E = (x.PEX1 + x.PEX2 * dfz + x.PEX3 * dfz**2) * (1 - x.PEX4 * ca.sign(kappa)) * s.LEX
    shift = c.Fz * (x.PVX1 + x.PVX2 * dfz) * s.LVX * s.LMUX * c.friction
    return D * ca.sin(_magic(Kx / (C * D), C, ca.fmin(E, 1), kappa)) + shift


def _pure_lateral(c, t, s, Ky):
    """Return Fy0 (4.E19) and the friction mu_y (4.E23)."""
    y = t.lateral
    _, dfz = _load_excess(c, t, s)
    dpi = _pressure_excess(c, t)
    camber = ca.sin(c.gamma)
    grip = s.LMUY * c.friction
    camber_stiffness = c.Fz * (y.PKY6 + y.PKY7 * dfz) * (1 + y.PPY5 * dpi) * s.LKYC
    camber_shift = c.Fz * (y.PVY3 + y.PVY4 * dfz) * camber * s.LKYC * grip
    alpha = c.tan_alpha + (y.PHY1 + y.PHY2 * dfz) * s.LHY
    alpha += (camber_stiffness * camber - y.SHY3 * camber_shift) / Ky + y.PHY3 * camber * s.LKYC
    mu = (y.PDY1 + y.PDY2 * dfz) * (1 + y.PPY3 * dpi + y.PPY4 * dpi**2)
    mu *= (1 - y.PDY3 * camber**2) * grip
    C = y.PCY1 * s.LCY
    D = mu * c.Fz
    side = (y.PEY3 + y.PEY4 * camber) * ca.sign(alpha)
    E = (y.PEY1 + y.PEY2 * dfz) * (1 + y.PEY5 * camber**2 - side) * s.LEY
    shift = c.Fz * (y.PVY1 + y.PVY2 * dfz) * s.LVY * grip + camber_shift
    return D * ca.sin(_magic(Ky / (C * D), C, ca.fmin(E, 1), alpha)) + shift, mu


def _weighting(B, C, E, x, shift):
    """Return the weighting G of combined slip, 1 at x = 0 (4.E50, 4.E58)."""
    return ca.cos(_magic(B, C, E, x + shift)) / ca.cos(_magic(B, C, E, shift))


def force(c: Contact, t: TyreCoefficients, s: TyreScaling) -> Force:
    """Return the force at combined slip (4.E50, 4.E58), weighted at similar slips.

    At them the unscaled tyre uses the same share of its friction. Friction and stiffness scaling
    move the slip of the peak; by the similarity method (Pacejka 2012, 4.2) combined slip moves with
    it; otherwise a stiff tyre on a wet road would leave its friction ellipse.
    """
    slope = stiffness(c, t, s)
    Fx0 = _pure_longitudinal(c, t, s, slope.Kx)
    Fy0, mu_y = _pure_lateral(c, t, s, slope.Ky)
    _, dfz = _load_excess(c, t, s)
    camber = ca.sin(c.gamma)
    kappa = c.kappa * s.LKX / (s.LMUX * c.friction)
    tan_alpha = c.tan_alpha * s.LKY / (s.LMUY * c.friction)

    x = t.combined_longitudinal
    B = (x.RBX1 + x.RBX3 * camber**2) * _cos_atan(x.RBX2 * kappa) * s.LXAL
    Fx = Fx0 * _weighting(B, x.RCX1, ca.fmin(x.REX1 + x.REX2 * dfz, 1), tan_alpha, x.RHX1)

    y = t.combined_lateral
    B = (y.RBY1 + y.RBY4 * camber**2) * _cos_atan(y.RBY2 * (tan_alpha - y.RBY3)) * s.LYKA
    E = ca.fmin(y.REY1 + y.REY2 * dfz, 1)
    induced = mu_y * c.Fz * (y.RVY1 + y.RVY2 * dfz + y.RVY3 * camber)
    induced *= _cos_atan(y.RVY4 * tan_alpha) * s.LVYKA
    induced *= ca.sin(y.RVY5 * ca.atan(y.RVY6 * kappa))
    return Force(Fx, Fy0 * _weighting(B, y.RCY1, E, kappa, y.RHY1 + y.RHY2 * dfz) + induced)


def mirrored_force(c: Contact, t: TyreCoefficients, s: TyreScaling) -> Force:
    """Return the force of the same tyre mounted on the right-hand side."""
    left = force(c._replace(tan_alpha=-c.tan_alpha, gamma=-c.gamma), t, s)
    return Force(left.Fx, -left.Fy)
