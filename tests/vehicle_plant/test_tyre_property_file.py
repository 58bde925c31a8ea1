"""A user's own tyre: property files are read as they are found, and mistakes are named."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest

from node_runtime import parameters as yaml_parameters
from node_runtime.parameters import ParameterError
from vehicle_plant import parameters, tyre, tyre_property_file
from vehicle_plant.tyre import Contact

# the forms that files are written in: comments of both kinds, tabs, small letters, tables, MASS in
# two sections, a Fortran exponent; the tyre is the example of the book
TEXT = """\
! a tyre [not a section] $ nor = this an entry
$-------------------------------------------------units
[UNITS]
LENGTH\t\t\t= 'meter'
FORCE = 'Newton'
ANGLE = "radians"
MASS = 'kg'
TIME = 'second'
[MODEL]
FITTYP = 61   $ Magic Formula 6.1
TYRESIDE = 'Left'
[INERTIA]
MASS = 9.3
[SHAPE]
{radial width}
 1.0    0.0
 0.9   -1.0d0

[vertical]
fnomin\t=\t4.0D+03   ! nominal load
[LONGITUDINAL_COEFFICIENTS]
PCX1 = 1.6
PDX1 = 1.0
PDX2 = -0.1
PKX1 = 16
RBX1 = 8.3
RBX2 = 5
RCX1 = .9
[LATERAL_COEFFICIENTS]
PCY1=1.3
PDY1 = 1 $ no space = no matter
PDY2 = -5e-002
PKY1 = -15
PKY2 = 2
PKY6 = -1
RBY1 = 4.9
RBY2 = 2.2
RCY1 = 1
"""


@pytest.fixture
def read(tmp_path):
    """Read a text as a file of the name my.tir."""

    def load(text):
        path = tmp_path / 'my.tir'
        path.write_text(text)
        return tyre_property_file.load(path)

    return load


def line_of(text, start):
    return 1 + next(i for i, line in enumerate(text.splitlines()) if line.startswith(start))


def test_property_file_is_the_tyre_of_its_yaml(read):
    """What it leaves out has the documented defaults; without pressure terms NOMPRES is free."""
    book = parameters.load_tyre('tyre_book.yaml')
    assert read(TEXT) == replace(book, reference=replace(book.reference, NOMPRES=200e3))


REQUIRED = 'fnomin PCX1 PDX1 PKX1 RBX1 RCX1 PCY1 PDY1 PKY1 PKY2 RBY1 RCY1'
SECTIONS = {'x': '[LONGITUDINAL', 'y': '[LATERAL', 'o': '[vertical'}


@pytest.mark.parametrize('key', REQUIRED.split())
def test_missing_needed_key_is_named_with_its_section(read, key):
    text = TEXT.replace(f'\n{key}', '\n$')
    line = line_of(text, SECTIONS[key[2].lower()])
    with pytest.raises(ParameterError, match=rf'my\.tir:{line}: {key.upper()}: is missing from \['):
        read(text)


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ("FORCE = 'Newton'", "FORCE = 'pound_force'", "FORCE: unit 'pound_force' is unknown"),
        ('ANGLE = "radians"', "ANGLE = 'degrees'", 'ANGLE: .* allowed radian'),
        ('PKY1 = -15', 'PKY1 = 15', 'lateral.PKY1: is 15.0'),
        ('PCX1 = 1.6', 'PCX1 = 160', 'longitudinal.PCX1: is 160.0'),
        ('PKX1 = 16', 'PKX1 = nan', 'longitudinal.PKX1: must be finite'),
        ('PKX1 = 16', 'PKX1 = sixteen', "PKX1: 'sixteen' is no number"),
        ('PKX1 = 16', 'PKX1 =', "PKX1: '' is no number"),
        ('PDX1 = 1.0', 'PCX1 = 1.0', 'PCX1: is there already, in line 22'),
        ('FITTYP = 61', 'FITTYP = 21', 'FITTYP: is 21; allowed 6 or 52 or 61 or 62'),
        ('FITTYP = 61', '$\n[MODEL]', 'FITTYP: is missing'),
        ("TYRESIDE = 'Left'", "TYRESIDE = 'TOP'", "TYRESIDE: is 'TOP'; allowed LEFT"),
        ('PDX1 = 1.0', 'PDX1 1.0', "'PDX1 1.0' is no section, no KEY = value"),
        ('RBX1 = 8.3', 'RBX1 = 8.3\nLMUY = -1', 'LMUY: is -1'),
        ('RBX1 = 8.3', 'RBX1 = 8.3\nLGAY = 2', 'LGAY: is not supported; allowed 1'),
        ('RBX1 = 8.3', 'RBX1 = 8.3\nPPX1 = 0.2', 'NOMPRES: is missing, PPX1 needs it'),
    ],
)
def test_mistake_is_named_with_file_line_and_key(read, old, new, message):
    text = TEXT.replace(old, new)
    assert text != TEXT
    line = line_of(text, new.splitlines()[-1])
    with pytest.raises(ParameterError, match=rf'my\.tir:{line}: {message}'):
        read(text)


def forces(tyre_set, bare, mirror=1):
    rng = np.random.default_rng(5)
    values = []
    for _ in range(20):
        Fz, kappa, slip, gamma = rng.uniform((1e3, -0.3, -0.3, -0.1), (8e3, 0.3, 0.3, 0.1))
        c = Contact(Fz, kappa, mirror * slip, mirror * gamma, 1.0, 220e3)
        F = tyre.force(c, tyre_set, bare)
        values += [F.Fx, mirror * F.Fy]
    return np.array(values)


ASYMMETRIC = """
PHY1 = .003\nPHY2 = .001\nPVY1 = .04\nPVY2 = .02\nPVY3 = -.3\nPVY4 = .1\nPEY1 = -1\nPEY3 = .2
PEY4 = -3\nRBY3 = .02\nRVY1 = .05\nRVY2 = .07\nRVY3 = .5\nRVY4 = 12\nRVY5 = 1.9\nRVY6 = -10
PHY3 = .01\nPKY3 = -.02\nPDY3 = 2\nRHX1 = .007\nRHY1 = .009
"""


def test_tyre_measured_on_the_right_is_the_mirror_of_the_same_coefficients_on_the_left(read, bare):
    unsaid = read(TEXT.replace("TYRESIDE = 'Left'", '!') + ASYMMETRIC)
    right = forces(read(TEXT.replace("'Left'", "'RIGHT'") + ASYMMETRIC), bare)
    assert read(TEXT + ASYMMETRIC) == unsaid
    assert right == pytest.approx(forces(unsaid, bare, mirror=-1), rel=1e-12)
    assert np.abs(right - forces(unsaid, bare)).max() > 50.0


def test_scaling_factors_of_the_file_are_those_of_the_plant(read, bare):
    """Pure slip: in combined slip only the car's own factors move the slip of the peak."""
    rng = np.random.default_rng(11)
    factors = {f.name: rng.uniform(0.8, 1.2) for f in fields(bare)} | {'LEX': 0.9, 'LEY': 0.9}
    shifts = 'PHX1 = .01\nPVX1 = .02\nPEX1 = .3\nPHY1 = .01\nPVY1 = .02\nPVY3 = -.3\nPEY1 = -.8\n'
    lines = ''.join(f'{key} = {value!r}\n' for key, value in factors.items())
    scaled = read(TEXT + shifts + '[SCALING_COEFFICIENTS]\n' + lines)
    plain = read(TEXT + shifts)
    for slip, which in (({'kappa': 0.07}, 0), ({'tan_alpha': 0.06}, 1)):
        c = Contact(3500.0, 0.0, 0.0, 0.04, 1.0, 220e3)._replace(**slip)
        by_car = tyre.force(c, plain, type(bare)(**factors))[which]
        assert tyre.force(c, scaled, bare)[which] == pytest.approx(by_car, rel=1e-12)


def test_pac2002_with_a_scaled_load_is_the_245_40r18_of_the_yaml(read):
    """The file that Chrono has; its formula, 5.2, has the camber shift PHY3 instead of others."""
    published = yaml_parameters.flatten(parameters.load_tyre('tyre_245_40r18.yaml'))
    not_in_it = ('FNOMIN', 'NOMPRES', 'PKY4', 'PKY6', 'PKY7', 'SHY3')
    named = {dotted.rpartition('.')[2]: value for dotted, value in published.items()}
    lines = [f'{k} = {v!r}\n' for k, v in named.items() if k not in not_in_it and v]
    text = (
        "[MODEL]\nPROPERTY_FILE_FORMAT = 'PAC2002'\nTYRESIDE = 'LEFT'\n[VERTICAL]\nFNOMIN = 4850\n"
        '[SCALING_COEFFICIENTS]\nLFZO = 0.81\n[LONGITUDINAL_COEFFICIENTS]\n'
    )
    values = yaml_parameters.flatten(read(text + ''.join(lines)))
    assert values == pytest.approx(published | {'reference.NOMPRES': 200e3}, rel=1e-12)
    assert named['PKY6'] == named['PKY7'] == named['SHY3'] == 0.0
    assert named['PHY3'] != 0.0


def test_property_file_works_wherever_the_yaml_does(tmp_path):
    path = tmp_path / 'my.tir'
    path.write_text(TEXT)
    car = tmp_path / 'car.yaml'
    text = parameters.config_file(parameters.DEFAULT_CAR).read_text()
    car.write_text(text.replace('tyre_205_60r15.yaml', str(path)))
    assert parameters.load(car).tyre == tyre_property_file.load(path)
    for name in ('nobody.tir', str(tmp_path / 'nobody.tir')):
        with pytest.raises(ParameterError, match=r'nobody\.tir'):
            parameters.load_tyre(name)
    with pytest.raises(ParameterError, match=f'^{re.escape(str(tmp_path))}: Is a directory'):
        tyre_property_file.load(tmp_path)  # as any that cannot be read
