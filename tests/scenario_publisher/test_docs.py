"""docs/scenarios.md says what the schema says."""

import dataclasses
import re
import typing
from pathlib import Path

import pytest

from msgs_yaml import strict_yaml
from scenario_publisher import friction_patches, schema

TEXT = (Path(__file__).parents[2] / 'docs/scenarios.md').read_text()
ROW = re.compile(r'^\| `([^`]+)` \|[^|]*\| ([^|]*) \|([^|]*)\|$', re.MULTILINE)
SECTIONS = {
    'Keys': (schema.File,),
    'A line': (schema.SegmentLine, schema.PointLine),
    'An edge': (schema.ConstantOffset, schema.OffsetTable, schema.PointEdge),
    'Speed': (schema.ConstantSpeed, schema.SpeedTable),
    'Start': (schema.StartOnPath, schema.StartPose),
    'A friction patch': (schema.FrictionPatch,),
    'An obstacle': (schema.MapObstacle, schema.RoadObstacle, schema.WaypointObstacle),
    'A way-point': (schema.Waypoint,),
}
# blocks with a section of their own, or told apart inside one
OWN = (schema.Line, schema.Edge, schema.ConstantSpeed | schema.SpeedTable)
OWN += (schema.StartOnPath | schema.StartPose, schema.Expectations)


def rows(title):
    """Return {key: (allowed, default)} of the table below a heading."""
    (body,) = re.findall(rf'^##+ {title}\b.*\n((?:(?!##).*\n)*)', TEXT, re.MULTILINE)
    return {key: (allowed, default.strip()) for key, allowed, default in ROW.findall(body)}


def keys(cls, prefix=''):
    """Return {dotted key: (what is allowed, default)} of a schema dataclass."""
    by_key, defaults = {}, strict_yaml.defaults(cls)
    for name, hint in strict_yaml.field_types(cls).items():
        by_key.update(_key(f'{prefix}{name}', hint, defaults.get(name, '')))
    return by_key


def _key(key, hint, default):
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if hint in OWN:
        return {key: (None, '')}
    if dataclasses.is_dataclass(hint):
        return keys(hint, f'{key}.')
    if origin is tuple and inside[-1] is Ellipsis:
        return _list(key, inside[0])
    return {key: (strict_yaml.describe_allowed(hint), default)}


def _list(key, hint):
    if hint == schema.Segment:
        classes = typing.get_args(hint)
        return {k: v for cls in classes for k, v in keys(cls, f'{key}[].').items()}
    if typing.get_origin(hint) is typing.Annotated:
        return {key: (strict_yaml.describe_allowed(hint), '')}
    return {key: (None, '')}


@pytest.mark.parametrize('title', SECTIONS)
def test_every_key_of_the_schema_is_documented_and_no_other(title):
    wanted = set().union(*(keys(cls) for cls in SECTIONS[title]))
    assert set(rows(title)) == wanted


@pytest.mark.parametrize('title', SECTIONS)
def test_documented_ranges_and_defaults_are_those_of_the_schema(title):
    documented = rows(title)
    for cls in SECTIONS[title]:
        for key, (allowed, default) in keys(cls).items():
            documented_range, documented_default = documented[key]
            if allowed is not None:
                assert documented_range == allowed
            if isinstance(default, float) and default < float('inf'):
                assert float(documented_default) == default


def test_the_complete_example_is_a_scenario(make):
    (example,) = re.findall(r'```yaml\n(schema.*?)```', TEXT, re.DOTALL)
    scn = make(example)
    assert len(scn.actors) == 3
    assert scn.friction == 0.9
    assert scn.start.speed == 16.0
    assert set(scn.patches.friction) == {0.2}


def test_documented_limits_of_friction_patches_are_those_of_the_code():
    allowed, _ = rows('Keys')['friction_patches']
    assert allowed == f'0 to {friction_patches.MAX_QUADRILATERALS} patches, see below'
    assert f'within {100 * friction_patches.MAX_SAGITTA:g} cm of the curve' in TEXT
    assert f'turn by less than {friction_patches.MAX_TURN:g} rad' in TEXT
    assert f'{friction_patches.MIN_SIZE:g} m or more behind `from_m`' in TEXT


def test_the_example_of_an_error_is_what_one_sees(make):
    (example,) = re.findall(r'^double_lane_change.yaml:(\d+): (.*)$', TEXT, re.MULTILINE)
    shipped = Path(__file__).parents[2] / 'scenario_publisher/scenarios/double_lane_change.yaml'
    moved = shipped.read_text().replace('y_m: 2.45', 'y_m: 9.45')
    with pytest.raises(ValueError, match=re.escape(example[1])) as caught:
        make(moved)
    assert str(caught.value) == f'bend.yaml:{example[0]}: {example[1]}'
