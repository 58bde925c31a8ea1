"""The amount of fuzzing: FUZZ_EXAMPLES per test, by default a few. See docs/faults.md."""

import os
from collections import Counter

import pytest
from hypothesis import HealthCheck, Phase, settings

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
EXAMPLES = int(os.environ.get('FUZZ_EXAMPLES', '8'))
settings.register_profile(
    'fuzz',
    max_examples=EXAMPLES,
    deadline=None,
    database=None,
    phases=(Phase.generate,),  # a failure is reported at once: shrinking batches takes minutes
    suppress_health_check=list(HealthCheck),
)
READ = 'read or refused by a reader, the plant or the scenario'
COUNTED = Counter()  # by (test, outcome)


@pytest.fixture(scope='session')
def count():
    """Return a function that counts inputs of a test by outcome; the sums are printed at the end.

    The outcome of inputs of readers and of nodes other than the controller is READ.
    """

    def one(test, inputs=1, outcome=READ):
        COUNTED[test, outcome] += inputs

    return one


def pytest_terminal_summary(terminalreporter):
    if COUNTED:
        terminalreporter.write_line(f'fuzzed inputs: {sum(COUNTED.values())}')
        sums = Counter()
        for (_, outcome), inputs in COUNTED.items():
            sums[outcome] += inputs
        for outcome, inputs in sorted(sums.items()):
            terminalreporter.write_line(f'  {inputs} {outcome}')
