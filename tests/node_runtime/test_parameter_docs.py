from typing import Annotated

import pytest

from node_runtime import parameter_docs, parameters
from node_runtime.parameters import Choice, Range, Struct


class Axle(Struct):
    """Brakes of an axle.

    Not shown.
    """

    force_n: Annotated[float, Range(0.0, 1e4, 'N, both wheels')]
    # not before
    # it is cold
    delay_ms: Annotated[int, Range(0, 200, 'ms')] | None  # after a command


class Brakes(Struct):
    """All brakes."""

    kind: Annotated[str, Choice('disc', 'drum')]
    speeds_mps: Annotated[tuple[float, ...], Range(0.0, 50.0, 'm/s')]
    front: Axle
    rear: Axle


FILE = parameters.ParameterFile(
    {'kind': 'disc', 'speeds_mps': [1.0, 2.5], 'front.force_n': 3000.0},
    {},
    {'kind': 'disc or drum', 'front.force_n': 'N, of the front axle'},
    None,
)


GROUPS = parameter_docs.describe(Brakes, FILE)
ROWS = {row.name: row for group in GROUPS for row in group.parameters}


def test_groups_have_the_first_paragraph_of_their_docstring():
    assert [(group.name, group.meaning) for group in GROUPS] == [
        ('', 'All brakes.'),
        ('front', 'Brakes of an axle.'),
        ('rear', 'Brakes of an axle.'),
    ]


def test_a_parameter_has_unit_range_default_and_a_meaning():
    force = ROWS['front.force_n']
    assert (force.unit, force.low, force.high, force.default) == ('N', 0.0, 1e4, 3000.0)
    assert (force.allowed, force.default_text, force.group) == ('0 to 10000', '3000', 'front')
    assert force.meaning == 'of the front axle'  # the comment of the file
    assert ROWS['rear.force_n'].meaning == 'both wheels'  # the remark of the range
    # the same field of another group lends its meaning
    assert ROWS['rear.delay_ms'].meaning == 'not before it is cold after a command'


def test_what_may_be_left_out_is_told_from_what_must_be_given():
    defaults = {
        'front.delay_ms': 'left out',
        'rear.force_n': 'none: must be given',
        'speeds_mps': '[1, 2.5]',
        'kind': 'disc',
    }
    assert {name: ROWS[name].default_text for name in defaults} == defaults
    assert ROWS['speeds_mps'].kind == 'list of number'
    assert ROWS['kind'].allowed == 'disc or drum'


@pytest.mark.parametrize(
    ('text', 'parts'),
    [
        ('m', ('m', '')),
        ('m ahead of the CoG', ('m', 'ahead of the CoG')),
        ('rad/s, 20 deg/s', ('rad/s', '20 deg/s')),
        ('kg m^2', ('kg m^2', '')),
        ('N s/m', ('N s/m', '')),
        ('s after an obstacle', ('s', 'after an obstacle')),
        ('m measured', ('m', 'measured')),
        ('steps', ('-', 'steps')),
        ('share of mu Fz', ('-', 'share of mu Fz')),
        ('1/m^2', ('1/m^2', '')),
        ('-, of noise', ('-', 'of noise')),
        ('N/(m/s)^2', ('N/(m/s)^2', '')),
    ],
)
def test_a_unit_is_split_from_what_follows(text, parts):
    assert parameter_docs.split_unit(text) == parts
