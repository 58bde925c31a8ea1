"""Coefficients of a Magic Formula 6.1 tyre, named as in Pacejka, Tire and Vehicle Dynamics, 4.3.2.

Coefficients have no unit unless their field gives one; the file of a tyre names its published
source. Some ranges only fix a sign: axes are those of ISO, so cornering stiffness is
negative. PHY3 is of Magic Formula 5.2 and PAC2002; 6.1 puts PKY6 and PKY7 in its place, less its
vertical shift with camber: SHY3, a name of ours, is 1 for 6.1 and 0 for 5.2.
"""

from dataclasses import dataclass
from typing import Annotated

from node_runtime.parameters import Range

Number = Annotated[float, Range(-1e4, 1e4, '-')]
Positive = Annotated[float, Range(1e-3, 1e3, '-')]
Negative = Annotated[float, Range(-1e3, -1e-3, '-')]
Shape = Annotated[float, Range(0.1, 5.0, '-')]


@dataclass(frozen=True)
class Reference:
    """The conditions to which the coefficients refer."""

    FNOMIN: Annotated[float, Range(100.0, 20000.0, 'N')]
    NOMPRES: Annotated[float, Range(50e3, 500e3, 'Pa')]


@dataclass(frozen=True)
class Longitudinal:
    """Pure longitudinal slip."""

    PCX1: Shape
    PDX1: Number
    PDX2: Number
    PDX3: Number
    PEX1: Number
    PEX2: Number
    PEX3: Number
    PEX4: Number
    PKX1: Positive
    PKX2: Number
    PKX3: Number
    PHX1: Number
    PHX2: Number
    PVX1: Number
    PVX2: Number
    PPX1: Number
    PPX2: Number
    PPX3: Number
    PPX4: Number


@dataclass(frozen=True)
class Lateral:
    """Pure side slip and camber."""

    PCY1: Shape
    PDY1: Number
    PDY2: Number
    PDY3: Number
    PEY1: Number
    PEY2: Number
    PEY3: Number
    PEY4: Number
    PEY5: Number
    PKY1: Negative
    PKY2: Positive
    PKY3: Number
    PKY4: Number
    PKY5: Number
    PKY6: Number
    PKY7: Number
    PHY1: Number
    PHY2: Number
    PHY3: Number
    SHY3: Annotated[float, Range(0.0, 1.0, '-')]
    PVY1: Number
    PVY2: Number
    PVY3: Number
    PVY4: Number
    PPY1: Number
    PPY2: Number
    PPY3: Number
    PPY4: Number
    PPY5: Number


@dataclass(frozen=True)
class CombinedLongitudinal:
    """Loss of longitudinal force by side slip."""

    RBX1: Positive
    RBX2: Number
    RBX3: Number
    RCX1: Shape
    REX1: Number
    REX2: Number
    RHX1: Number


@dataclass(frozen=True)
class CombinedLateral:
    """Loss of lateral force by longitudinal slip, and the side force which that slip induces."""

    RBY1: Positive
    RBY2: Number
    RBY3: Number
    RBY4: Number
    RCY1: Shape
    REY1: Number
    REY2: Number
    RHY1: Number
    RHY2: Number
    RVY1: Number
    RVY2: Number
    RVY3: Number
    RVY4: Number
    RVY5: Number
    RVY6: Number


@dataclass(frozen=True)
class TyreCoefficients:
    """The coefficients of one tyre, mounted on the left."""

    reference: Reference
    longitudinal: Longitudinal
    lateral: Lateral
    combined_longitudinal: CombinedLongitudinal
    combined_lateral: CombinedLateral


@dataclass(frozen=True)
class TyreScaling:
    """The factors lambda of Pacejka 4.3.1: 1 leaves the published tyre as it is."""

    LFZO: Annotated[float, Range(0.1, 10.0, '-')]
    LCX: Annotated[float, Range(0.1, 10.0, '-')]
    LMUX: Annotated[float, Range(0.1, 10.0, '-')]
    LEX: Annotated[float, Range(0.0, 10.0, '-')]
    LKX: Annotated[float, Range(0.1, 10.0, '-')]
    LHX: Annotated[float, Range(0.0, 10.0, '-')]
    LVX: Annotated[float, Range(0.0, 10.0, '-')]
    LCY: Annotated[float, Range(0.1, 10.0, '-')]
    LMUY: Annotated[float, Range(0.1, 10.0, '-')]
    LEY: Annotated[float, Range(0.0, 10.0, '-')]
    LKY: Annotated[float, Range(0.1, 10.0, '-')]
    LHY: Annotated[float, Range(0.0, 10.0, '-')]
    LVY: Annotated[float, Range(0.0, 10.0, '-')]
    LKYC: Annotated[float, Range(0.0, 10.0, '-')]
    LXAL: Annotated[float, Range(0.1, 10.0, '-')]
    LYKA: Annotated[float, Range(0.1, 10.0, '-')]
    LVYKA: Annotated[float, Range(0.0, 10.0, '-')]
