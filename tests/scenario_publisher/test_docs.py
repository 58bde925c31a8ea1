"""What docs/scenarios.md shows is what one sees; its keys are in tests/docs/test_reference.py."""

import re
from pathlib import Path

import pytest

from scenario_publisher import friction_patches

TEXT = (Path(__file__).parents[2] / 'docs/scenarios.md').read_text()


def test_the_complete_example_is_a_scenario(make):
    (example,) = re.findall(r'```yaml\n(schema.*?)```', TEXT, re.DOTALL)
    scn = make(example)
    assert len(scn.actors) == 3
    assert scn.friction == 0.9
    assert scn.start.speed == 16.0
    assert set(scn.patches.friction) == {0.2}


def test_documented_limits_of_friction_patches_are_those_of_the_code():
    assert f'{friction_patches.MAX_QUADRILATERALS} in all' in TEXT
    assert f'within {100 * friction_patches.MAX_SAGITTA:g} cm of the curve' in TEXT
    assert f'turn by less than {friction_patches.MAX_TURN:g} rad' in TEXT


def test_the_example_of_an_error_is_what_one_sees(make):
    (example,) = re.findall(r'^double_lane_change.yaml:(\d+): (.*)$', TEXT, re.MULTILINE)
    shipped = Path(__file__).parents[2] / 'scenario_publisher/scenarios/double_lane_change.yaml'
    moved = shipped.read_text().replace('y_m: 2.45', 'y_m: 9.45')
    with pytest.raises(ValueError, match=re.escape(example[1])) as caught:
        make(moved)
    assert str(caught.value) == f'bend.yaml:{example[0]}: {example[1]}'
