"""No YAML file and no parameter ends in anything but an error that says what is wrong."""

from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.storage.message_filing import RecorderParams
from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml import contract, share
from msgs_yaml.strict_yaml import YamlError
from node_runtime import node_parameters, parameters
from node_runtime.parameters import ParameterError
from scenario_publisher import scenario
from scenario_publisher.scenario import ScenarioError
from vehicle_plant.parameters import NodeParams

FUZZ = settings.get_profile('fuzz')
BATCH = 4
# what is in them is fuzzed in tests/scenario_publisher/test_mistakes.py; of each kind of block one
SCENARIOS = ('iso_3888_2', 'low_mu_obstacle', 'cut_in', 'moving_obstacle')
CONFIGS = {
    'mpcc.yaml': ('mpcc_controller', ControllerParams),
    'car.yaml': ('mpcc_controller', CarParams),
    'bmw_545i.yaml': ('vehicle_plant', NodeParams),
    'recorder.yaml': ('bags', RecorderParams),
}
# text of a sound file, what reads a path, and the one error that it may raise
FILES = {name: (scenario.load(name).text, scenario.load, ScenarioError) for name in SCENARIOS}
FILES |= {
    name: (
        share.path(package, 'config', name).read_text(),
        partial(parameters.load, cls),
        ParameterError,
    )
    for name, (package, cls) in CONFIGS.items()
}
FILES['topics.yaml'] = (
    share.path('msgs_yaml', 'topics.yaml').read_text(),
    contract.read_contract,
    YamlError,
)
VALUES = (
    '', 'nan', '.inf', '-.inf', '-1', '0', '1e999', '1e-400', 'true', 'no', '[]', '{}', '[1, [2]]',
    '{a: 1}', '"', "'", '&a', '*a', '!!python/object:os.system', '~', '0x10', '12:30', '2026-01-01',
    '- 1', '? a', '|', '>', '%', '@', '\t', '\x00', 'ü', '9' * 400, '[' * 60, '<<: {}', 'a: b: c',
)  # fmt: skip
SETTINGS = (
    0, 1, -1, 10**30, 0.5, float('nan'), float('inf'), -float('inf'), 1e308, True, False, '',
    'mpcc', '../../etc/passwd', 'x' * 5000, (), (1.0,), (1, 2, 3), ('a',), (float('nan'),), None,
    b'ab',
)  # fmt: skip
number = st.integers(0, 9999)
edits = st.lists(st.tuples(number, number, number), min_size=1, max_size=3)


def edited(text, several):
    """Return a text file with some lines changed, lost, doubled or moved."""
    lines = text.splitlines()
    for place, how, choice in several:
        at = place % len(lines)
        key, colon, _ = lines[at].partition(':')
        value = VALUES[choice % len(VALUES)]
        lines[at : at + 1] = (
            [f'{key}{colon} {value}'],
            [],
            [lines[at]] * 2,
            [' ' * (choice % 5) + lines[at].lstrip()],
            [lines[at][: choice % (len(lines[at]) + 1)] + value],
        )[how % 5]
        lines = lines or ['']
    return '\n'.join(lines)


def error_text(error, use, *given):
    """Return the text of the one allowed error, None without an error."""
    try:
        use(*given)
    except error as raised:
        return str(raised)
    return None


def batch(strategy, size=BATCH):
    return st.lists(strategy, min_size=size, max_size=size)


@pytest.mark.parametrize('name', FILES)
def test_every_file_is_read_or_refused_with_its_name(name, tmp_path):
    text, use, error = FILES[name]
    path = tmp_path / 'file.yaml'

    @FUZZ
    @given(batch(edits))
    def example(several):
        for one in several:
            path.write_text(edited(text, one))
            reason = error_text(error, use, path)
            assert reason is None or str(path) in reason

    example()


@pytest.mark.parametrize('name', [name for name in CONFIGS if name != 'car.yaml'])
def test_every_parameter_given_at_start_is_taken_or_refused_with_a_reason(name):
    package, cls = CONFIGS[name]
    defaults = share.path(package, 'config', name)
    known = [*parameters.leaves(cls), *node_parameters.COMMON]

    @FUZZ
    @given(batch(st.tuples(number, number)))
    def example(several):
        for place, choice in several:
            chosen = known[place % len(known)]
            given_one = {chosen: SETTINGS[choice % len(SETTINGS)]}
            error = error_text(ParameterError, node_parameters.resolve, cls, defaults, given_one)
            if error is None:
                _, declared = node_parameters.resolve(cls, defaults, given_one)
                (one,) = (one for one in declared if one.name == chosen)
                parameters.check(one.leaf, one.value, chosen, str)
            else:
                # of a file that can be read its own name is what helps
                assert chosen in error or str(given_one[chosen]) in error

    example()
