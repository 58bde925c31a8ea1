"""Coefficients of a Magic Formula 6.1 tyre, named as in Pacejka, Tire and Vehicle Dynamics, 4.3.2.

Coefficients have no unit unless their field gives one; the file of a tyre names its published
source. Some ranges only fix a sign: axes are those of ISO, so cornering stiffness is
negative. PHY3 is of Magic Formula 5.2 and PAC2002; 6.1 puts PKY6 and PKY7 in its place, less its
vertical shift with camber: SHY3, a name of ours, is 1 for 6.1 and 0 for 5.2.
"""

from dataclasses import make_dataclass
from typing import Annotated

from node_runtime.parameters import Range, Struct

_NUMBER = Range(-1e4, 1e4, '-')
_FACTOR = Range(0.1, 10.0, '-')
_MAY_BE_ZERO = ('LEX', 'LHX', 'LVX', 'LEY', 'LHY', 'LVY', 'LKYC', 'LVYKA')
_RANGES = {  # where it is not the usual one of the group
    'FNOMIN': Range(100.0, 20000.0, 'N'),
    'NOMPRES': Range(50e3, 500e3, 'Pa'),
    'PKY1': Range(-1e3, -1e-3, '-'),
    'SHY3': Range(0.0, 1.0, '-'),
    **dict.fromkeys(('PCX1', 'PCY1', 'RCX1', 'RCY1'), Range(0.1, 5.0, '-')),
    **dict.fromkeys(('PKX1', 'PKY2', 'RBX1', 'RBY1'), Range(1e-3, 1e3, '-')),
    **dict.fromkeys(_MAY_BE_ZERO, Range(0.0, 10.0, '-')),
}


def _group(name, about, fields, usual=_NUMBER):
    """Return a frozen dataclass of numbers, each with its range."""
    kinds = [(field, Annotated[float, _RANGES.get(field, usual)]) for field in fields.split()]
    namespace = {'__doc__': about, '__module__': __name__}
    return make_dataclass(name, kinds, frozen=True, namespace=namespace)


Reference = _group(
    'Reference',
    'The conditions to which the coefficients refer.',
    'FNOMIN NOMPRES',
)
Longitudinal = _group(
    'Longitudinal',
    'Pure longitudinal slip.',
    'PCX1 PDX1 PDX2 PDX3 PEX1 PEX2 PEX3 PEX4 PKX1 PKX2 PKX3 PHX1 PHX2 PVX1 PVX2 PPX1 PPX2 PPX3 '
    'PPX4',
)
Lateral = _group(
    'Lateral',
    'Pure side slip and camber.',
    'PCY1 PDY1 PDY2 PDY3 PEY1 PEY2 PEY3 PEY4 PEY5 PKY1 PKY2 PKY3 PKY4 PKY5 PKY6 PKY7 PHY1 PHY2 '
    'PHY3 SHY3 PVY1 PVY2 PVY3 PVY4 PPY1 PPY2 PPY3 PPY4 PPY5',
)
CombinedLongitudinal = _group(
    'CombinedLongitudinal',
    'Loss of longitudinal force by side slip.',
    'RBX1 RBX2 RBX3 RCX1 REX1 REX2 RHX1',
)
CombinedLateral = _group(
    'CombinedLateral',
    'Loss of lateral force by longitudinal slip, and the side force which that slip induces.',
    'RBY1 RBY2 RBY3 RBY4 RCY1 REY1 REY2 RHY1 RHY2 RVY1 RVY2 RVY3 RVY4 RVY5 RVY6',
)
TyreScaling = _group(
    'TyreScaling',
    'The factors lambda of Pacejka 4.3.1: 1 leaves the published tyre as it is.',
    'LFZO LCX LMUX LEX LKX LHX LVX LCY LMUY LEY LKY LHY LVY LKYC LXAL LYKA LVYKA',
    _FACTOR,
)


class TyreCoefficients(Struct):
    """The coefficients of one tyre, mounted on the left."""

    reference: Reference
    longitudinal: Longitudinal
    lateral: Lateral
    combined_longitudinal: CombinedLongitudinal
    combined_lateral: CombinedLateral
