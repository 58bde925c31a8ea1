"""What has to hold at the operating point, and what came out."""

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.study import statistics, tables
from experiments.study.claim_rules import D_SFT, KEPT, STABLE_DEG
from experiments.study.drives import Record

SHARE = 0.95


def of(records: Mapping[str, Sequence[Record]]) -> list[dict[str, Any]]:
    """Return the targets of the controllers that were driven, each with what came out."""
    rows = []
    if 'mpcc' in records:
        rows += _of_mpcc(records['mpcc'])
    if 'mpcc_no_ca' in records:
        gaps = [run.value('min_v2o_per_obstacle_m.1') for run in records['mpcc_no_ca']]
        rows.append(_shared('mpcc_no_ca: V2O < 0 at obstacle 1', [gap < 0 for gap in gaps]))
    return rows


def _of_mpcc(runs):
    return [
        _shared('mpcc: completed', [run.value('completed') for run in runs]),
        _median('mpcc: min V2O [m]', runs, 'min_v2o_m', least=KEPT * D_SFT),
        _median('mpcc: min V2E [m]', runs, 'min_v2e_m', least=KEPT * D_SFT),
        _median('mpcc: peak sideslip angle [deg]', runs, 'peak_sideslip_deg', most=STABLE_DEG),
    ]


def _shared(name, holds):
    found = statistics.share(holds)
    return {
        'target': name,
        'wanted': f'>= {SHARE:.0%} of the runs',
        'measured': f'{found.holds} of {found.runs} [{found.low:.3f}, {found.high:.3f}]',
        'met': found.share >= SHARE,
    }


def _median(name, runs, quantity, least=None, most=None):
    found = statistics.summary([run.value(quantity) for run in runs])
    wanted = f'median >= {least:g}' if most is None else f'median <= {most:g}'
    good = found.median >= least if most is None else found.median <= most
    return {
        'target': name,
        'wanted': wanted,
        'measured': f'{found.median:.3f} [{found.least:.3f}, {found.most:.3f}]',
        'met': good,
    }


def told(rows: Sequence[Mapping[str, Any]], kph: float) -> str:
    """Return the targets as Markdown."""
    if not rows:
        return ''
    header = ['target', 'wanted', 'measured', 'met']
    lines = [[row['target'], row['wanted'], row['measured'], _yes(row['met'])] for row in rows]
    return f'## Targets at {kph:g} km/h\n\n{tables.markdown(header, lines)}\n'


def _yes(met):
    return 'yes' if met else '**no**'
