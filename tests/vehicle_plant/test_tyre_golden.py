"""The tyre against forces that another implementation computed, to 0.1 %.

The points are of the Magic Formula Tyre Library (github.com/teasit/magic-formula-tyre-library,
commit e9f0354) for the 205/60R15 of Pacejka 2006, as listed by github.com/KMoula30/outlap.

The misfit of Fy, 0.09 % at the point of the same load and camber zero, is one of definition, not of
arithmetic. That library puts the slip angle alpha itself into the pure lateral force and its
tangent into the weighting by combined slip. Pacejka 2012 (4.E3) and the plant take the tangent in
both: tan(0.063) is 0.13 % more than 0.063, on a curve that has begun to bend. Given its own slip,
the plant meets it to nine digits, and Fx, where only the tangent occurs, at once. What is left at
kappa other than zero is 0.003 N, from a small number which that library adds to denominators, and
with camber 0.1 N: there it takes sin(gamma) in one place and gamma in another.
"""

from typing import NamedTuple

import numpy as np
import pytest

from vehicle_plant import tyre
from vehicle_plant.tyre import Contact

FOUR_DEGREES = 0.06981317008


class Golden(NamedTuple):
    kappa: float
    alpha: float
    gamma: float
    Fz: float
    Fx: float
    Fy: float


PURE_SIDE = [
    Golden(0.0, 0.063, 0.0, 2000.0, -81.86027374, -1383.005814),
    Golden(0.0, 0.21, 0.0, 2000.0, -27.38732579, -2006.056707),
    Golden(0.0, -0.042, 0.0, 2000.0, -103.7989583, 1080.070841),
    Golden(0.0, -0.105, FOUR_DEGREES, 2000.0, -65.662769, 1909.221514),
    Golden(0.0, 0.021, FOUR_DEGREES, 2000.0, -107.5221535, -639.7008008),
    Golden(0.0, 0.105, -FOUR_DEGREES, 4000.0, -88.42292281, -3208.071105),
    Golden(0.0, -0.168, 0.0, 4000.0, -60.86872875, 4048.181136),
    Golden(0.0, -0.0315, -FOUR_DEGREES, 4000.0, -163.9509139, 1728.663822),
]
ALONG = [
    Golden(-0.3, 0.0, 0.0, 2000.0, -2267.63603, -118.6843526),
    Golden(0.03, 0.0, 0.0, 2000.0, 977.4660065, 126.1319875),
    Golden(-0.12, 0.0, 0.0, 4000.0, -4802.461581, -174.3413015),
    Golden(0.06, 0.0, 0.0, 6000.0, 6020.91493, 131.9223582),
    Golden(-0.09, 0.0, 0.0, 8000.0, -9247.864118, 176.6151186),
    Golden(0.2, 0.0, -FOUR_DEGREES, 4000.0, 4739.474164, 218.5561613),
    Golden(-0.1, 0.0, FOUR_DEGREES, 4000.0, -4681.078534, -552.7547115),
]
COMBINED = [
    Golden(-0.15, 0.068, -FOUR_DEGREES, 4000.0, -4260.0679, -1769.374617),
    Golden(0.1, 0.102, 0.0, 4000.0, 3202.106538, -2661.263108),
    Golden(0.25, -0.17, 0.0, 4000.0, 3574.751478, 2125.787333),
    Golden(-0.05, -0.034, 0.0, 4000.0, -3393.623227, 1404.012579),
    Golden(-0.1, -0.102, FOUR_DEGREES, 4000.0, -3471.291898, 2798.354197),
]


def force(golden, tan_alpha, params, bare):
    c = Contact(golden.Fz, golden.kappa, tan_alpha, golden.gamma, 1.0, 220e3)
    return tyre.force(c, params.tyre, bare)


def test_first_golden_point_is_met_to_a_tenth_of_a_percent(params, bare):
    golden = PURE_SIDE[0]
    F = force(golden, np.tan(golden.alpha), params, bare)
    assert F.Fx == pytest.approx(golden.Fx, rel=1e-7)
    assert F.Fy == pytest.approx(golden.Fy, rel=1e-3)
    assert F.Fy != pytest.approx(golden.Fy, rel=5e-4)  # the misfit that is explained above


@pytest.mark.parametrize('golden', PURE_SIDE)
def test_lateral_force_is_the_golden_one_at_the_golden_slip(params, bare, golden):
    assert force(golden, golden.alpha, params, bare).Fy == pytest.approx(golden.Fy, rel=1e-9)
    assert force(golden, np.tan(golden.alpha), params, bare).Fx == pytest.approx(
        golden.Fx, rel=1e-8
    )


@pytest.mark.parametrize('golden', ALONG)
def test_longitudinal_slip_gives_the_golden_forces(params, bare, golden):
    F = force(golden, 0.0, params, bare)
    assert F.Fx == pytest.approx(golden.Fx, rel=1e-8)
    assert F.Fy == pytest.approx(golden.Fy, abs=0.1 if golden.gamma else 0.01)


@pytest.mark.parametrize('golden', COMBINED)
def test_combined_slip_gives_the_golden_forces(params, bare, golden):
    """Fy is that of the tangent less what the tangent adds to pure slip, times the weighting."""
    tangent = force(golden, np.tan(golden.alpha), params, bare)
    assert tangent.Fx == pytest.approx(golden.Fx, rel=1e-8)
    pure = golden._replace(kappa=0.0)
    ratio = (tangent.Fy - golden.Fy) / golden.Fy
    definition = (
        force(pure, np.tan(golden.alpha), params, bare).Fy
        - force(pure, golden.alpha, params, bare).Fy
    )
    weighted = tangent.Fy / force(pure, np.tan(golden.alpha), params, bare).Fy
    assert abs(ratio) < 2e-3
    assert tangent.Fy - golden.Fy == pytest.approx(definition * weighted, rel=0.2)
