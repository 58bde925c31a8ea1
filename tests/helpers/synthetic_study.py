"""A made-up study whose answers are known, in the columns of `experiments study settings`."""

from itertools import product
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from experiments.settings import arms, outcomes, preregistration
from experiments.settings import setting as settings
from experiments.settings_analysis.study_tables import Study

PLAN_FILE = Path(__file__).parents[2] / 'experiments/config/settings_study.yaml'
NOTES = MappingProxyType(
    {'git_commit': 'none', 'points': '0', 'rejected': '{}', 'interrupted': 'false'}
)
HITS, CLEAR = -0.1, 1.0  # m
OFFSETS = (0.0, 0.01, -0.01, 0.02, -0.02)  # of the perturbations, on every response


def make_study(count=80, seed=1, factorial=12):
    """Return a study of `count` settings in which every car does as in the paper, but for:

    the onset of braking, 20 m earlier below a velocity tolerance of 6 m/s and equal above; the
    least speed, which is the same; the sideslip of the lineage, which is small.
    """
    plan = preregistration.load(PLAN_FILE)
    rng = np.random.default_rng(seed)
    rows = []
    for number, values in enumerate(settings.draw(plan, seed, 0, count)):
        values['S'] = 0.7 + 0.5 * (number + 0.5) / count
        common = {'setting': number, **values, 'plant_limit_mps2': 8.0, 'error': ''}
        common |= {'speed_mps': 20.0, 'obstacle_2_at_m': 120.0}
        early = 20.0 if values['velocity_tolerance_mps'] < 6.0 else 0.0
        noise = rng.normal(0.0, 0.05)
        for k, offset in enumerate(OFFSETS):
            bend = noise + offset
            cars = {
                arms.MPCC: _car(values, 3.0 + bend, 60.0 + bend, kept=0.1),
                arms.MATCHED: _car(values, 9.0 + bend, 60.0 + early + bend, kept=-0.1),
                arms.LINEAGE: _car(values, 3.5 + bend, 60.0 + early + bend, kept=-0.1),
            }
            if not k:
                cars[arms.NO_CA] = _car(values, 2.0, None, kept=0.1) | {'v2o_1_m': HITS}
            for arm, car in cars.items():
                rows.append(common | {'arm': arm, 'perturbation': k} | car)
        if number < factorial:
            for bits in product('01', repeat=len(arms.FACTORS)):
                car = _car(values, 3.0 + 6.0 * (bits[0] == '1') + noise, 60.0, kept=0.1)
                arm = arms.FACTORIAL + ''.join(bits)
                rows.append(common | {'arm': arm, 'perturbation': 0} | car)
    drives = pd.DataFrame(rows)
    judged = pd.DataFrame(list(outcomes.build(plan, rows)))
    return Study(plan, drives, judged, seed, dict(NOTES))


def _car(values, sideslip, onset, kept):
    return {
        'completed': True,
        'left_road': False,
        'lost': False,
        'collided_by': None,
        'v2o_1_m': CLEAR,
        'outline_1_m': CLEAR,
        'min_outline_gap_m': CLEAR,
        'outline_edge_m': CLEAR,
        'min_v2o_m': values['safety_obstacle_m'] + kept,
        'min_v2e_m': values['safety_edge_m'] + kept,
        'limit_share': 1.0,
        'peak_sideslip_deg': sideslip,
        'brake_onset_planned_at_m': onset,
        'min_speed_mps': 20.0,
    }
