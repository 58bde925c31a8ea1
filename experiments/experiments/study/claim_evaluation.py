"""Evaluation of the claims over paired runs: our numbers, verdict with interval, cause."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation import frame_distances
from experiments import statistical_inference
from experiments.statistical_inference import CONFIDENCE
from experiments.study import claims, run_spec, run_statistics, tables, variants
from experiments.study.claims import NOT, Claim, Runs, Shown
from experiments.study.metric_distributions import POINT_KPH, RUNS, SPEEDS_KPH, run_at_speed
from experiments.study.run_statistics import BY_NAME, Quantity, Share, summarise
from experiments.study.runner import Record, Runner
from experiments.study.variants import BASE, BASELINE, SWITCHES, Switch

STEM = 'claims'
COMMAND = 'experiments study claims'
OVERSHOOTS = 'overshoots'  # a list rather than a number
# the claim on the two frames, by closed forms
RADII_M = (200.0, 100.0, 50.0, 20.0)  # growing curvature
GAPS_M = tuple(range(1, 41))  # along the path, up to the preview of 2 s
BESIDE_M = 1.0  # obstacle from the path
REACH_M = 2.1  # both radii
NOT_COMPARED = dict.fromkeys(('margin', *Share._fields))
Rows = Mapping[str, Sequence[Record]]  # of the ablation at the operating point, one per draw


class Evaluation(NamedTuple):
    """The result of `experiments study claims`."""

    rows: list[dict[str, Any]]  # of claims.json
    files: list[Path]


def run(
    runner: Runner,
    out: Path,
    runs: int = RUNS,
    cause_runs: int | None = None,
    speeds_kph: Sequence[float] = SPEEDS_KPH,
    roles: Mapping[str, str] = variants.ROLES,
    command: str = COMMAND,
) -> Evaluation:
    """Evaluate every claim over paired runs; write claims.md, .csv and claims.json (a list).

    The first of `speeds_kph` is the operating point, the others show how far a verdict extends;
    `cause_runs` of the draws, by default all, are used to find causes; `command` is recorded in the
    files. Raises BagError.
    """
    cause_runs = cause_runs or runs
    compared = variants.role_variants(roles)
    draws = run_spec.draw_runs(runs)
    paired = {kph: pair_runs(run_at_speed(runner, compared, kph, draws)) for kph in speeds_kph}
    switched, cause_draws = variants.ablation_variants(roles), run_spec.draw_runs(cause_runs)
    ablation = run_at_speed(runner, switched, POINT_KPH, cause_draws)
    at_point, *_ = paired.values()
    elsewhere = {kph: draws for kph, draws in paired.items() if kph != speeds_kph[0]}
    rows = [_row(claim, at_point, ablation, elsewhere) for claim in claims.CLAIMS]
    rows += [_convergence_row(ablation), overestimation_row()]
    origin = tables.build_provenance(
        command,
        compared,
        runs=runs,
        cause_runs=cause_runs,
        speeds_kph=list(speeds_kph),
    )
    text = f'{claims_table(rows)}\n{_legend(cause_runs)}\n{undecided_list(rows)}'
    files = tables.write_tables(out, STEM, 'The claims of the paper', rows, text, origin)
    # claims.json is a plain list for other programs, in which each row holds its reasons
    listed = [row | {'reasons': claims.find_reasons([row['verdict']])} for row in rows]
    (out / f'{STEM}.json').write_text(tables.dump_json(listed))
    (out / f'{STEM}_provenance.json').write_text(tables.dump_json(origin))
    return Evaluation(listed, [*files, out / f'{STEM}_provenance.json'])


def pair_runs(records: Mapping[str, Sequence[Record]]) -> list[Runs]:
    """Return the runs of every draw by role."""
    return [dict(zip(records, runs)) for runs in zip(*records.values())]


def _row(
    claim: Claim,
    draws: Sequence[Runs],
    ablation: Rows,
    elsewhere: Mapping[float, Sequence[Runs]],
    names: Mapping[str, str] = variants.ROLES,
) -> dict[str, Any]:
    strict, loose = (_share(rule, draws) for rule in (claim.strict, claim.loose))
    outcome = claims.decide(strict, loose)
    cause, cause_data = find_cause(claim, draws, ablation, outcome)
    return {
        'key': claim.key,
        'claim': claim.claim,
        'paper': claim.paper,
        'ours': summarise_claim(claim.shown, draws, names),
        'operating_point': f'{POINT_KPH:g} km/h, {len(draws)} paired runs',
        'verdict': claims.verdict(claim.undecided, outcome),
        'rule_outcome': outcome,
        'interval': _interval(strict),
        'strict': {'rule': claim.strict.text, **strict._asdict()},
        'loose': {'rule': claim.loose.text, **loose._asdict()},
        'alike': _count_alike(claim.compared, draws),
        'elsewhere': {
            f'{kph:g} km/h': _interval(_share(claim.strict, others))
            for kph, others in elsewhere.items()
        },
        'cause': cause,
        'cause_data': cause_data,
    }


def _share(rule, draws):
    return run_statistics.share([rule.holds(runs) for runs in draws])


def _count_alike(name, draws):
    """Return margin and number of the draws in which MPCC and baseline are alike."""
    if not name:
        return NOT_COMPARED
    alike = run_statistics.share([claims.are_alike(name, runs) for runs in draws])
    return {'margin': claims.ALIKE[name], **alike._asdict()}


def _interval(share):
    return f'{share.holds}/{share.runs} [{share.low:.2f}, {share.high:.2f}]'


def _convergence_row(ablation):
    """Return the row on the priority, on the MPCC's own states, everything else equal."""
    pairs = [
        {'mpcc': gaussian, 'frenet': step}
        for gaussian, step in zip(ablation[BASE], ablation['cartesian lag step'])
    ]
    return _row(claims.CONVERGENCE, pairs, ablation, {}, {'mpcc': 'Gaussian', 'frenet': 'step'})


def find_cause(
    claim: Claim, draws: Sequence[Runs], ablation: Rows, outcome: str
) -> tuple[str, list[dict[str, Any]]]:
    """Return the cause as a sentence, and the counts behind it.

    The switched role of the claim is taken by the row before and by the row after each switch. A
    switch is a cause when it turns the loose rule in more than half of the runs in which it can:
    gained of those in which it did not hold before, lost of those in which it did. The probability
    of so many by chance (one-sided binomial) is corrected by Holm's method over the switches that
    are tested for the effect. A rejected claim has no cause; the sentence lists the switches that
    would produce its direction.
    """
    if claim.switched is None:
        return claim.reason, []
    data = [_count_turned(claim, draws, ablation, switch) for switch in SWITCHES]
    # switches of the baseline do not concern the other roles
    data = [row for row in data if row['before'] == BASE or claim.switched == 'frenet']
    forward = [row for row in data if row['before'] == BASE]
    backward = [row for row in data if row['before'] == BASELINE]
    if outcome == NOT:
        sentence = _cause_sentence('would bring it about', forward, 'gained')
        return f'direction only ({claim.loose.text}): {sentence}', data
    if claim.switched == 'mpcc':
        parts = [_cause_sentence('makes it fail', forward, 'lost')]
    else:
        parts = [_cause_sentence('brings it about', forward, 'gained')]
    if any(row['held_before'] for row in backward):
        parts.append(_cause_sentence('undoes it', backward, 'lost'))
    return '; '.join(parts), data


def _count_turned(
    claim: Claim, draws: Sequence[Runs], ablation: Rows, switch: Switch
) -> dict[str, Any]:
    before, after = (
        [
            claim.loose.holds({**runs, claim.switched: record})
            for runs, record in zip(draws, ablation[name])
        ]
        for name in (switch.before, switch.after)
    )
    pairs = list(enumerate(zip(before, after), start=1))
    return {
        'factor': switch.factor,
        'before': switch.before,
        'after': switch.after,
        'pairs': len(pairs),
        'held_before': sum(before),
        'gained': [number for number, (held, holds) in pairs if holds and not held],
        'lost': [number for number, (held, holds) in pairs if held and not holds],
    }


def _cause_sentence(effect, data, key):
    """Name the switches with the effect in most runs, then those with it in some."""
    counts = {row['factor']: (len(row[key]), _turnable(row, key)) for row in data}
    tested = {factor: pair for factor, pair in counts.items() if pair[1]}
    p_values = statistical_inference.holm(
        {factor: run_statistics.majority_p_value(*pair) for factor, pair in tested.items()}
    )
    most, some = [], []
    for factor, (count, total) in tested.items():
        if count:
            is_certain = p_values[factor] <= 1 - CONFIDENCE
            (most if is_certain else some).append(f'{factor} ({count}/{total})')
    if not most and not some:
        return f'no switch alone {effect}'
    in_some = f', in some: {", ".join(some)}' if some else ''
    return f'alone {effect} in most runs: {", ".join(most) or "none"}{in_some}'


def _turnable(row, key):
    """Return in how many pairs a rule can be gained or lost: it did not hold before, or it did."""
    held = row['held_before']
    return row['pairs'] - held if key == 'gained' else held


def summarise_claim(shown: Sequence[Shown], draws: Sequence[Runs], names: Mapping[str, str]) -> str:
    """Return median and range of the shown numbers over the runs; `names` are those of the roles.

    "quantity [unit]: role median [least, most], role ..."; quantities are separated by semicolons.
    """
    parts = []
    for quantity, group in groupby(shown, key=lambda number: number.quantity):
        records = {names[role]: [runs[role] for runs in draws] for role, _ in group}
        if quantity == OVERSHOOTS:
            title, cell = f'widest beyond {claims.AFTER_M:g} m [m]', _widest_overshoot
        else:
            title, cell = _title(BY_NAME[quantity]), _median_and_range
        cells = (f'{role} {cell(runs, quantity)}' for role, runs in records.items())
        parts.append(f'{title}: {", ".join(cells)}')
    return '; '.join(parts)


def _title(quantity: Quantity):
    return quantity.title if quantity.unit == '-' else f'{quantity.title} [{quantity.unit}]'


def _median_and_range(runs, name):
    quantity, over = BY_NAME[name], run_statistics.summarise_runs(runs, name)
    if not over.runs:
        return 'none'
    median, least, most = map(quantity.format, (over.median, over.least, over.most))
    if over.median is None:  # in fewer than half of the runs
        return f'{least} to {most} in {over.runs} of {len(runs)} runs'
    some = f' in {over.runs} of {len(runs)} runs' if over.runs < len(runs) else ''
    return f'{median} [{least}, {most}]{some}'


def _widest_overshoot(runs, name):
    """Return size and station of the widest overshoot of each run after the second lane change."""
    after = ([o for o in run.value(name) if o['x_m'] >= claims.AFTER_M] for run in runs)
    widest = [max(run, key=lambda overshoot: overshoot['amount_m']) for run in after if run]
    if not widest:
        return 'none'
    amount, x = (summarise([overshoot[key] for overshoot in widest]) for key in ('amount_m', 'x_m'))
    return (
        f'{amount.median:.2f} [{amount.least:.2f}, {amount.most:.2f}] at {x.median:.0f} m in '
        f'{len(widest)} of {len(runs)} runs'
    )


def overestimation_by_side() -> dict[str, dict[str, Any]]:
    """Return, inside and outside of the curve, how path coordinates overestimate the distance.

    `grows` counts the (gap, pair of neighbouring radii) at which the sharper curve overestimates
    more; `at_20m` is the overestimation [m] 20 m before the obstacle, by radius. Closed forms.
    """
    sides = {}
    for side, inside in (('inside', BESIDE_M), ('outside', -BESIDE_M)):
        gaps, radii = np.array(GAPS_M, dtype=float), np.array(RADII_M)[:, None]
        error = frame_distances.circle_distances(radii, gaps, inside, REACH_M).overestimation
        grows = np.diff(error, axis=0) > 0
        at_20m = error[:, GAPS_M.index(20)]
        sides[side] = {
            'grows': int(np.count_nonzero(grows)),
            'of': int(grows.size),
            'at_20m': {f'{radius:g}': float(value) for radius, value in zip(RADII_M, at_20m)},
        }
    return sides


def overestimation_row() -> dict[str, Any]:
    """Return the row on the two frames: overestimation grows with curvature.

    It follows from closed forms, so there is no interval.
    """
    sides = overestimation_by_side()
    inside, outside = sides['inside'], sides['outside']
    if all(side['grows'] == side['of'] for side in sides.values()):
        outcome = claims.REPRODUCED
    else:
        outcome = claims.PARTLY if inside['grows'] == inside['of'] else NOT
    empty = {'rule': 'closed form', 'holds': None, 'runs': None, 'low': None, 'high': None}
    return {
        'key': 'overestimation',
        'claim': 'path coordinates overestimate V2O, the more the greater the curvature',
        'paper': 'grows with curvature',
        'ours': (
            f'inside the curve at {inside["grows"]} of {inside["of"]} places, outside at '
            f'{outside["grows"]} of {outside["of"]}; 20 m ahead on a radius of 20 m '
            f'{inside["at_20m"]["20"]:+.2f} m and {outside["at_20m"]["20"]:+.2f} m'
        ),
        'operating_point': 'circle, no drive',
        'verdict': outcome,
        'rule_outcome': outcome,
        'interval': 'exact, closed form',
        'strict': empty,
        'loose': empty,
        'alike': NOT_COMPARED,
        'elsewhere': {},
        'cause': 'geometry: chord against arc; outside near the obstacle the sign turns',
        'cause_data': [sides],
    }


def claims_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the claims as a Markdown table."""
    header = [
        *('claim', 'paper', 'ours: median [least, most]', 'verdict'),
        *('holds in runs [95 %]', 'at other speeds', 'cause'),
    ]
    lines = [
        [
            *(row[name] for name in ('claim', 'paper', 'ours', 'verdict', 'interval')),
            '; '.join(f'{at}: {share}' for at, share in row['elsewhere'].items()) or '–',
            row['cause'],
        ]
        for row in rows
    ]
    return tables.markdown_table(header, lines)


def undecided_list(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the reasons for the claims that are not decided, as a Markdown list."""
    reasons = claims.find_reasons(row['verdict'] for row in rows)
    if not reasons:
        return ''
    lines = ''.join(f'- ({key}) {reason}\n' for key, reason in reasons.items())
    return f'Not decided at this operating point, because\n\n{lines}'


def _legend(cause_runs):
    return (
        'Rules and margins are in docs/study.md. A cause is a single switch that turns the loose '
        'rule, (a/b) in a of the b runs in which it can; "in most runs" is corrected for the '
        f'number of switches (Holm); at most {cause_runs} paired runs were driven for it. Where a '
        'claim does not hold, "direction only" names what would bring about its loose rule.\n'
    )
