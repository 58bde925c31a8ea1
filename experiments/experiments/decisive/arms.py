"""The controllers of the study as rows: a controller file, settings, and weights of a search.

All have the car file, the believed friction and the safety distances of their task.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from random import Random
from typing import Any

from experiments.decisive.search import Weights
from experiments.drive_row import Offset, Row
from experiments.families import draw
from experiments.families.lane_change_task import NAME

COMPARED = ('mpcc', 'frenet')  # the verdicts are about their difference
FACTORIAL = 'factorial:'
HEADING = 'tolerances.heading_rad'
# those of both controller files when the plan was fixed: of arms that name no searched weights
BY_HAND: Weights = {
    'tolerances.contouring_m': 0.5,
    'tolerances.lag_m': 0.5,
    HEADING: 0.175,
    'tolerances.velocity_mps': 3.0,
    'tolerances.steer_rate_radps': 0.349,
    'tolerances.force_rate_nps': 20_000.0,
    'priorities.obstacle': 1000.0,
    'priorities.edge': 300.0,
}


def tuned_parameters(plan: Mapping[str, Any], arm: str) -> list[str]:
    """Return the parameters that are searched for an arm."""
    without = plan['tuned'][arm].get('without', ())
    return [name for name in plan['search']['ranges'] if name not in without]


def settings(plan: Mapping[str, Any], arm: str, tuned: Mapping[str, Weights]) -> dict[str, Any]:
    """Return the parameters of an arm beside those of its task, from the `tuned` weights by arm."""
    if arm.startswith(FACTORIAL):
        chosen = {HEADING: tuned['frenet'][HEADING], **tuned['mpcc']}
        for digit, changed in zip(arm.removeprefix(FACTORIAL), plan['factors'].values()):
            chosen |= changed if digit == '1' else {}
        return chosen
    if arm in plan['tuned']:
        return {**tuned[arm], **plan['tuned'][arm].get('settings', {})}
    described = plan['derived'][arm]
    weights = tuned[described['weights']] if 'weights' in described else BY_HAND
    return {**weights, **described.get('settings', {})}


def row(
    plan: Mapping[str, Any],
    arm: str,
    chosen: Mapping[str, Any],
    seed: int,
    index: int,
    start: int = 0,
    labels: Iterable[tuple[str, Any]] = (),
) -> Row:
    """Return the drive of an arm with chosen parameters in a task.

    Each start has an offset of the speed of its own, which is the same for every arm.
    """
    most = plan['starts']['speed_kph']
    speed_kph = Random(f'{seed} {index} {start}').uniform(-most, most)
    if arm.startswith(FACTORIAL):
        controller = 'mpcc'
    else:
        controller = {**plan['tuned'], **plan['derived']}[arm]['controller']
    pairs = tuple((f'controller.{name}', value) for name, value in chosen.items())
    return Row(
        f'{NAME}:{index}',
        controller,
        pairs,
        seed,
        offset=Offset(speed_kph=speed_kph),
        knows_limit=False,
        labels=(('arm', arm), ('task', index), ('start', start), *labels),
    )


def combinations(plan: Mapping[str, Any]) -> Sequence[str]:
    """Return the arms of the factorial."""
    return [FACTORIAL + ''.join(bits) for bits in product('01', repeat=len(plan['factors']))]


def task_values(seed: int, index: int) -> Mapping[str, Any]:
    """Return what was drawn of a task."""
    return draw.draw(NAME, seed, index).values
