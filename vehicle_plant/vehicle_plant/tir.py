"""Tyre property files (.tir) of the Magic Formula, as a `TyreSet`: bring your own tyre.

Read: FITTYP 61 and 62 (Magic Formula 6.1; 6.2 has the same forces) and 6, 52 or
PROPERTY_FILE_FORMAT 'PAC2002' (5.2). Needed are FNOMIN, PCX1, PDX1, PKX1, RBX1, RCX1 and PCY1,
PDY1, PKY1, PKY2, RBY1, RCY1, and NOMPRES where a pressure term is not zero; where it is missing,
PKY4 is 2 and every other coefficient 0, which leaves its term out. Units must be SI.

The file's scaling factors are multiplied into the coefficients. A tyre measured on the right
(TYRESIDE) is mirrored, since a `TyreSet` is a left-hand tyre; the default is left. 5.2 shifts by
camber with PHY3, 6.1 with PKY6 and PKY7 (SHY3, ours, is 1); 5.2 and PAC2002 take angles where 6.1
takes tan(alpha) and sin(gamma), which is the same to 1 % up to 10 degrees.

Not read: moments, and geometry, stiffness and mass, which are the car's (`wheel` in its file).
"""

from pathlib import Path

from node_runtime import parameters
from vehicle_plant import tir_file
from vehicle_plant.tir_file import TirFile
from vehicle_plant.tyre_set import TyreScaling, TyreSet

_SI = {
    'LENGTH': ('meter', 'metre', 'm'),
    'FORCE': ('newton', 'n'),
    'ANGLE': ('radian', 'radians', 'rad'),
    'MASS': ('kg', 'kilogram'),
    'TIME': ('second', 'sec', 's'),
    'PRESSURE': ('pascal', 'pa'),
}
_FORMULAS = {'6': '5.2', '52': '5.2', '61': '6.1', '62': '6.1'}
_FORMATS = {'PAC2002': '5.2'}
_SIDES = ('LEFT', 'RIGHT', 'SYMMETRIC')
_NEEDED = ('FNOMIN', *('PCX1', 'PDX1', 'PKX1', 'RBX1', 'RCX1'))
_NEEDED += ('PCY1', 'PDY1', 'PKY1', 'PKY2', 'RBY1', 'RCY1')
_DEFAULTS = {'PKY4': 2.0, 'SHY3': 1.0}
_PRESSURE_PA = 200e3  # of files without pressure terms, where it has no effect
_SECTIONS = {
    'reference': 'VERTICAL',
    'longitudinal': 'LONGITUDINAL_COEFFICIENTS',
    'lateral': 'LATERAL_COEFFICIENTS',
    'combined_longitudinal': 'LONGITUDINAL_COEFFICIENTS',
    'combined_lateral': 'LATERAL_COEFFICIENTS',
}
# what each factor multiplies, Pacejka 2012 (4.E9) to (4.E67)
_SCALED = {
    'LFZO': ('FNOMIN',),
    'LCX': ('PCX1',),
    'LMUX': ('PDX1', 'PDX2', 'PVX1', 'PVX2'),
    'LEX': ('PEX1', 'PEX2', 'PEX3'),
    'LKX': ('PKX1', 'PKX2'),
    'LHX': ('PHX1', 'PHX2'),
    'LVX': ('PVX1', 'PVX2'),
    'LCY': ('PCY1',),
    'LMUY': ('PDY1', 'PDY2', 'PVY1', 'PVY2', 'PVY3', 'PVY4'),
    'LEY': ('PEY1', 'PEY2'),
    'LKY': ('PKY1',),
    'LHY': ('PHY1', 'PHY2'),
    'LVY': ('PVY1', 'PVY2'),
    'LKYC': ('PKY6', 'PKY7', 'PVY3', 'PVY4', 'PHY3'),
    'LXAL': ('RBX1', 'RBX3'),
    'LYKA': ('RBY1', 'RBY4'),
    'LVYKA': ('RVY1', 'RVY2', 'RVY3'),
}
_NEUTRAL = {'LGAX': 1.0, 'LGAY': 1.0, 'LMUV': 0.0}
# the terms that are odd in side slip and camber together
_ONE_SIDED = ('RHX1', 'PHY1', 'PHY2', 'PVY1', 'PVY2', 'PEY3', 'RBY3', 'RVY1', 'RVY2')


def load(path: Path) -> TyreSet:
    """Read a tyre. Raises ParameterError that names file, line and key, and OSError."""
    file = tir_file.read(path)
    _check_units(file)
    formula = _formula(file)
    raw = _coefficients(file)
    checked = parameters.build_from(TyreSet, raw, lambda key: _source(file, key))
    values = {key.rpartition('.')[2]: v for key, v in parameters.flatten(checked).items()}
    values = _scaled(file, values)
    if formula == '5.2':
        # its camber shift is PHY3 alone, without the two terms that 6.1 has instead
        values |= {'PKY6': 0.0, 'PKY7': 0.0, 'SHY3': 0.0}
    if _side(file) == 'RIGHT':
        values |= {key: -values[key] for key in _ONE_SIDED}
    return parameters.build(TyreSet, {key: values[key.rpartition('.')[2]] for key in raw}, path)


def _check_units(file: TirFile) -> None:
    for key, entry in file.sections.get('UNITS', {}).items():
        if key in _SI and entry.text.lower() not in _SI[key]:
            words = ' or '.join(_SI[key])
            raise file.error(entry.line, f'{key}: unit {entry.text!r} is unknown; allowed {words}')


def _formula(file: TirFile) -> str:
    """Return the version of the Magic Formula."""
    if entry := file.find('FITTYP'):
        if entry.text not in _FORMULAS:
            allowed = ' or '.join(_FORMULAS)
            raise file.error(entry.line, f'FITTYP: is {entry.text}; allowed {allowed}')
        return _FORMULAS[entry.text]
    entry = file.find('PROPERTY_FILE_FORMAT')
    if entry is None or entry.text.upper() not in _FORMATS:
        line = entry.line if entry else file.lines.get('MODEL')
        raise file.error(line, f'FITTYP: is missing; allowed {" or ".join(_FORMULAS)}')
    return _FORMATS[entry.text.upper()]


def _side(file: TirFile) -> str:
    entry = file.find('TYRESIDE')
    side = entry.text.upper() if entry else 'LEFT'
    if side not in _SIDES:
        raise file.error(entry.line, f'TYRESIDE: is {side!r}; allowed {" or ".join(_SIDES)}')
    return side


def _number(file: TirFile, key: str) -> float | None:
    """Return a number, None where it is missing."""
    entry = file.find(key)
    if entry is None:
        return None
    try:
        return float(entry.text.lower().replace('d', 'e'))  # Fortran writes 1.0D+03
    except ValueError:
        raise file.error(entry.line, f'{key}: {entry.text!r} is no number') from None


def _coefficients(file: TirFile) -> dict[str, float]:
    """Return what the file and the defaults give, by the dotted names of `TyreSet`."""
    found = {}
    for dotted in parameters.leaves(TyreSet):
        group, _, key = dotted.partition('.')
        value = _number(file, key)
        if value is None and key in _NEEDED:
            section = _SECTIONS[group]
            raise file.error(file.lines.get(section), f'{key}: is missing from [{section}]')
        found[dotted] = _DEFAULTS.get(key, 0.0) if value is None else value
    if file.find('NOMPRES') is None:
        for key in (dotted.rpartition('.')[2] for dotted, value in found.items() if value):
            if key.startswith('PP'):
                raise file.error(file.find(key).line, f'NOMPRES: is missing, {key} needs it')
        found['reference.NOMPRES'] = _PRESSURE_PA
    return found


def _source(file: TirFile, dotted: str) -> str:
    entry = file.find(dotted.rpartition('.')[2])
    return f'{file.path}:{entry.line}' if entry else str(file.path)


def _scaled(file: TirFile, values: dict[str, float]) -> dict[str, float]:
    for factor, neutral in _NEUTRAL.items():
        if _number(file, factor) not in (None, neutral):
            line = file.find(factor).line
            raise file.error(line, f'{factor}: is not supported; allowed {neutral:g}')
    values = dict(values)
    for factor, leaf in parameters.leaves(TyreScaling).items():
        given = _number(file, factor)
        if given is not None:
            parameters.check(leaf, given, factor, lambda key: _source(file, key))
            values |= {key: values[key] * given for key in _SCALED[factor]}
    return values
