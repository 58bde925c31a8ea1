"""Tyre property files (.tir) of the Magic Formula, read as `TyreCoefficients`.

Formats: FITTYP 61 and 62 (Magic Formula 6.1; 6.2 has the same forces) and 6, 52 or
PROPERTY_FILE_FORMAT 'PAC2002' (5.2). Required are FNOMIN, PCX1, PDX1, PKX1, RBX1, RCX1 and PCY1,
PDY1, PKY1, PKY2, RBY1, RCY1, and NOMPRES where a pressure term is not zero. PKY4 defaults to 2 and
every other coefficient to 0, which leaves its term out. Units must be SI.

The scaling factors of the file are multiplied into the coefficients. A tyre measured on the right
(TYRESIDE) is mirrored, since `TyreCoefficients` are those of a left-hand tyre, the default. 5.2
shifts by camber with PHY3, 6.1 with PKY6 and PKY7 (SHY3, our name, is 1); 5.2 and PAC2002 take
angles where 6.1 takes tan(alpha) and sin(gamma), which is the same to 1 % up to 10 degrees.
Ignored: moments, and geometry, stiffness and mass, which are the car's (`wheel` in its file).

A file has `[SECTION]`, `KEY = value`, and comments from `$` or `!` on. Case does not matter,
except inside quotes, and neither do tabs or the order of sections. Tables (a `{header}` and rows of
numbers) are skipped.
"""

import re
from pathlib import Path
from typing import NamedTuple

from node_runtime import parameters
from node_runtime.parameters import ParameterError
from vehicle_plant.tyre_coefficients import TyreCoefficients, TyreScaling

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
_REQUIRED = ('FNOMIN', *('PCX1', 'PDX1', 'PKX1', 'RBX1', 'RCX1'))
_REQUIRED += ('PCY1', 'PDY1', 'PKY1', 'PKY2', 'RBY1', 'RCY1')
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
_SECTION = re.compile(r'\[\s*([^\]]+?)\s*\]$')
_ENTRY = re.compile(r'([A-Za-z_]\w*)\s*=\s*(.*)$')
_TABLE = re.compile(r'\{.*\}$|[-+.\deEdD\s,]+$')
_COMMENT = re.compile(r"""('[^']*'|"[^"]*")|[$!].*""")


class Entry(NamedTuple):
    """A value as it is written, without quotes, and its line."""

    text: str
    line: int


class PropertyFile(NamedTuple):
    """Entries by section and key, and the line of each section; names in capitals."""

    path: Path
    sections: dict[str, dict[str, Entry]]
    lines: dict[str, int]

    def find(self, key: str) -> Entry | None:
        """Return an entry of any section but UNITS, some of whose keys occur in others, too."""
        for name, entries in self.sections.items():
            if name != 'UNITS' and key in entries:
                return entries[key]
        return None

    def error(self, line: int | None, what: str) -> ParameterError:
        """Return the error about a line of the file."""
        return ParameterError(f'{self.path}:{line}: {what}' if line else f'{self.path}: {what}')


def load(path: Path) -> TyreCoefficients:
    """Read a tyre. Raises ParameterError that names file, line and key."""
    file = _read(path)
    for key, entry in file.sections.get('UNITS', {}).items():
        if key in _SI and entry.text.lower() not in _SI[key]:
            words = ' or '.join(_SI[key])
            raise file.error(entry.line, f'{key}: unit {entry.text!r} is unknown; allowed {words}')
    formula = _formula(file)

    def source(dotted):
        entry = file.find(dotted.rpartition('.')[2])
        return f'{file.path}:{entry.line}' if entry else str(file.path)

    raw = _coefficients(file)
    checked = parameters.build(TyreCoefficients, raw, source)
    values = {key.rpartition('.')[2]: v for key, v in parameters.flatten(checked).items()}
    for factor, neutral in _NEUTRAL.items():
        if _number(file, factor) not in (None, neutral):
            line = file.find(factor).line
            raise file.error(line, f'{factor}: is not supported; allowed {neutral:g}')
    for factor, leaf in parameters.leaves(TyreScaling).items():
        given = _number(file, factor)
        if given is not None:
            parameters.check(leaf, given, factor, source)
            values |= {key: values[key] * given for key in _SCALED[factor]}
    if formula == '5.2':
        # its camber shift is PHY3 alone, without the two terms that 6.1 has instead
        values |= {'PKY6': 0.0, 'PKY7': 0.0, 'SHY3': 0.0}
    entry = file.find('TYRESIDE')
    side = entry.text.upper() if entry else 'LEFT'
    if side not in _SIDES:
        raise file.error(entry.line, f'TYRESIDE: is {side!r}; allowed {" or ".join(_SIDES)}')
    if side == 'RIGHT':
        values |= {key: -values[key] for key in _ONE_SIDED}
    scaled = {key: values[key.rpartition('.')[2]] for key in raw}
    return parameters.build(TyreCoefficients, scaled, path)


def _formula(file: PropertyFile) -> str:
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


def _number(file: PropertyFile, key: str) -> float | None:
    """Return a number, None where it is missing."""
    entry = file.find(key)
    if entry is None:
        return None
    try:
        return float(entry.text.lower().replace('d', 'e'))  # Fortran writes 1.0D+03
    except ValueError:
        raise file.error(entry.line, f'{key}: {entry.text!r} is no number') from None


def _coefficients(file: PropertyFile) -> dict[str, float]:
    """Return the values of the file and the defaults, by the dotted names of `TyreCoefficients`."""
    values = {}
    for dotted in parameters.leaves(TyreCoefficients):
        group, _, key = dotted.partition('.')
        value = _number(file, key)
        if value is None and key in _REQUIRED:
            section = _SECTIONS[group]
            raise file.error(file.lines.get(section), f'{key}: is missing from [{section}]')
        values[dotted] = _DEFAULTS.get(key, 0.0) if value is None else value
    if file.find('NOMPRES') is None:
        for key in (dotted.rpartition('.')[2] for dotted, value in values.items() if value):
            if key.startswith('PP'):
                raise file.error(file.find(key).line, f'NOMPRES: is missing, {key} needs it')
        values['reference.NOMPRES'] = _PRESSURE_PA
    return values


def _read(path: Path) -> PropertyFile:
    """Read a property file. Raises ParameterError that names file and line."""
    file = PropertyFile(Path(path), {}, {})
    section = ''
    try:
        # the encoding of comments is unknown in old files; keys and numbers are ASCII
        lines = file.path.read_text(encoding='latin-1').splitlines()
    except OSError as error:
        raise ParameterError(f'{path}: {error.strerror or error}') from None
    for line, raw in enumerate(lines, start=1):
        text = _COMMENT.sub(lambda match: match[1] or '', raw).strip()
        if match := _SECTION.match(text):
            section = match[1].upper()
            file.lines.setdefault(section, line)
            file.sections.setdefault(section, {})
        elif match := _ENTRY.match(text):
            entries, key = file.sections.setdefault(section, {}), match[1].upper()
            if key in entries:
                raise file.error(line, f'{key}: is there already, in line {entries[key].line}')
            entries[key] = Entry(match[2].strip('\'" \t'), line)
        elif text and not _TABLE.match(text):
            raise file.error(line, f'{text!r} is no section, no KEY = value and no table')
    return file
