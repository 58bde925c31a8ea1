"""A scenario file causes no error but ScenarioError; the node can publish each loaded scenario.

By hand: `python tests/fuzz/atheris_scenarios.py -runs=100000 [corpus]`, see docs/faults.md.
"""

import dataclasses
import random
import re
import typing
import warnings
from collections.abc import Iterator

import coverage_guided

with coverage_guided.instrumented('scenario_publisher', 'msgs_yaml'):
    from msgs_yaml import conformance, encode, strict_yaml
    from node_runtime.parameters import Range
    from scenario_publisher import scenario, schema
    from scenario_publisher.scenario import ScenarioError

FILE = coverage_guided.scratch() / 'scenario.yaml'
COMMENT = re.compile(r'[ \t]*#.*|^\s*\n', re.MULTILINE)
VALUES = (
    *(
        '',
        '0',
        '-0.0',
        '1',
        '-1',
        '0.5',
        '3.14',
        '1e-3',
        '1e308',
        '5e-324',
        '.inf',
        '.nan',
        '1e999',
    ),
    *(
        '~',
        'true',
        'no',
        '0x10',
        '12:30',
        '2026-99-99',
        '[]',
        '{}',
        '"',
        "'",
        '&a',
        '*a',
        '!!int x',
    ),
    *('!!python/none', '|', '>', '%', '\t', '\x00', '\ufeff', 'ü', '9' * 400, '[' * 40, '<<: {}'),
    *(': ', ', ', '- ', '{', '}', '[', ']', '\n', '\n  ', '---\n', '...\n'),
    'path_again: &b\n',
    '{stations_m: [0, 50, 100], offsets_m: [4, 5, 4]}',
    '{stations_m: [0, 50], speeds_mps: [20, 10]}',
    'points_m: [[0, 0], [30, 0], [60, 3.5], [90, 3.5], [120, 0]]',
    '{x_m: 0, y_m: 0, yaw_rad: 0.1, speed_mps: 10}',
    '{station_m: 40, offset_m: 1, radius_m: 1, across_mps: 1, appears_at_s: 1, disappears_at_s: 2}',
    'friction_patches: [{from_m: 0, to_m: 50, from_offset_m: -2, to_offset_m: 0, friction: 0.3}]\n',
    'sampling: {path_m: 5, edges_m: 0.1}\n',
)
TIMES = (0.0, 1.0, 600.0)  # s, of a run


def words() -> tuple[str, ...]:
    """Return every key and the ends of every range in the schema, and values hard to read."""
    found, left = {}, [schema.File]
    while left:
        hint = left.pop()
        if dataclasses.is_dataclass(hint):
            known = strict_yaml.field_types(hint)
            found |= dict.fromkeys(f'{name}: ' for name in known) | dict.fromkeys(known)
            left += known.values()
            continue
        left += [one for one in typing.get_args(hint) if one is not Ellipsis]
        if isinstance(hint, Range):
            found |= dict.fromkeys((repr(hint.low), repr(hint.high)))
    return (*found, *VALUES)


def changed(data: bytes, choose: random.Random) -> bytes:
    """Return a file with some words, lines or numbers replaced."""
    text = data.decode('utf-8', 'ignore')
    return coverage_guided.mutate_text(text, WORDS, choose).encode()


def seeds() -> Iterator[bytes]:
    """Yield the scenarios of the package without their comments."""
    for name in scenario.available():
        yield COMMENT.sub('', scenario.load(name).text).encode()


def look(data: bytes) -> None:
    """Load a file and check the scenario."""
    FILE.write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('error')  # no number may be lost on the way
            check(scenario.load(FILE))
    except ScenarioError as error:
        if not str(error).startswith(str(FILE)):
            raise
    finally:
        FILE.unlink()


def check(loaded: scenario.Scenario) -> None:
    """Assert that the messages of the node obey the contract at every time."""
    published = {
        '/scenario/reference': [encode.reference(loaded.reference)],
        '/scenario/road_edges': [encode.road_edges(loaded.edges)],
        '/scenario/obstacles': [
            encode.obstacles(scenario.obstacles_at(loaded, t, loaded.reference.stamp_ns))
            for t in TIMES
        ],
    }
    for topic, messages in published.items():
        for message in messages:
            assert conformance.check(topic, message) == [], topic


WORDS = words()
if __name__ == '__main__':
    coverage_guided.run(look, changed, seeds())
