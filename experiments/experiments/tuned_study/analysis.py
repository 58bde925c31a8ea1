"""Estimands, intervals and verdicts of the study of tuned controllers, from its tables.

The unit is the replicate: a seed, its searches and its fresh tasks. A difference is the mean over
the tasks of a replicate, first arm minus second; intervals are Student's t over replicates. Tables:

drives     a row per drive: replicate, judged (False of the searches), arm, task, start (0; others
           measure the scatter of starts and decide nothing), S, stratum, latency_ms, compensated,
           friction_error, avoided (False also of a drive without a result), and the columns of
           `QUANTITIES`; arms factorial:0000 to 1111 had tasks which both compared arms avoid
trials     every point of the searches: replicate, arm, round, drives (of the search, up to then),
           cost, is_recommended

Shares, their differences and margins are fractions of 1; 0.01 is a point.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bags.errors import BagError
from experiments.statistical_inference import Estimate, estimate, holm_levels
from experiments.tuned_study.arms import COMPARED, FACTORIAL

# compared arms; the first pair is that of the verdicts
PAIRS = (
    COMPARED,
    ('mpcc_heading', COMPARED[1]),
    ('mpcc', 'frenet_matched'),
    ('mpcc', 'frenet_lineage'),
)
DIFFERENCE, HEADING_DIFFERENCE = (' - '.join(pair) for pair in PAIRS[:2])
HEADING_GAIN = ('mpcc_heading', 'mpcc')


class Quantity(NamedTuple):
    """What is compared of two drives."""

    sign: int  # +1 where more is better
    label: str
    better: str  # in a word
    unit: str


QUANTITIES = {
    'peak_sideslip_deg': Quantity(-1, 'peak sideslip', 'smaller', 'deg'),
    'kept_m': Quantity(1, 'distance kept', 'greater', 'm'),
    'min_speed_mps': Quantity(1, 'least speed', 'higher', 'm/s'),
    'brake_onset_m': Quantity(-1, 'start of braking', 'earlier', 'm'),  # as in the paper
}
FACTORS = ('frame', 'lag', 'heading', 'shape')  # digits of a factorial arm, 1 as the baseline
LATENCIES = ('0 ms', '25 ms', '50 ms', 'compensated')
# what a regression of avoidance is on, beside the stratum of S
HIGH, LOW, LATENCY = 'friction believed 5 % too high', '5 % too low', '25 ms of latency'
KNOWN_LATENCY = '50 ms, in its model with the servos'
POINTS = 'points'
LIMIT_SHARE = 0.9  # of the tasks, avoided at the limit demand S90; most arms avoid half at any S


class Verdict(NamedTuple):
    """A decision; the interval has the level at which Holm's procedure tests this hypothesis."""

    hypothesis: str
    estimate: Estimate
    confidence: float
    margin: float
    text: str
    more: int  # replicates that would make the interval as wide as the margin, 0 unless open


class Row(NamedTuple):
    """An estimate of what, of which arm or pair, and among which tasks."""

    name: str
    what: str
    group: str
    estimate: Estimate
    unit: str = POINTS
    note: str = ''


class Results(NamedTuple):
    """Everything that the study estimates."""

    verdicts: Sequence[Verdict]
    stop: str
    shares: Sequence[Row]  # avoided, by arm and stratum
    gaps: Sequence[Row]  # by pair; of the compared ones by stratum and by latency
    limits: Sequence[Row]  # S90 by arm, and its ratio, by latency
    losses: Sequence[Row]  # avoidance lost, by arm and their difference
    balances: Sequence[Row]  # better, worse, their difference and its parts, by pair and quantity
    effects: Sequence[Row]  # of factors and pairs of factors, by quantity
    unsteady: Sequence[Row]  # share of tasks in which starts disagree, by arm


def analyse(plan: Mapping[str, Any], drives: pd.DataFrame) -> Results:
    """Return all estimates. Raises BagError where the compared arms had different tasks."""
    judged, factorial = _judged(drives)
    gap, balance = _confirmatory(judged, plan)
    present = set(judged['arm'])
    pairs = [pair for pair in PAIRS if present.issuperset(pair)]
    compared = judged[(judged['start'] == 0) & judged['arm'].isin(COMPARED)]
    return Results(
        verdicts=decide(gap, balance, plan['confirmatory']),
        stop=stop(plan, drives),
        shares=list(_shares(judged)),
        gaps=list(_gaps(judged, [*pairs, HEADING_GAIN] if PAIRS[1] in pairs else pairs)),
        limits=list(_limits(compared)),
        losses=list(_losses(compared)),
        balances=[row for pair in pairs for row in _balances(judged, pair, plan)],
        effects=list(_effects(factorial)),
        unsteady=list(_unsteady(judged)),
    )


def stop(plan: Mapping[str, Any], drives: pd.DataFrame) -> str:
    """Return whether the study stops after the replicates in a table of drives.

    Raises BagError as `analyse`.
    """
    samples = _confirmatory(_judged(drives)[0], plan)
    widths = [width(estimate(values)) for values in samples]
    return stop_rule(len(samples[0]), widths, plan['stop'])


def decide(
    gap: Sequence[float], balance: Sequence[float], rules: Mapping[str, Any]
) -> list[Verdict]:
    """Return the verdicts on avoidance gap and balance of sideslip, each given by replicate.

    `rules` are those under `confirmatory` in a plan.

    Holm's procedure (1979, Scandinavian Journal of Statistics 6, 65-70) over both, in terms of
    intervals: that with the smaller p has 97.5 %; if it excludes 0, the other has 95 %, else 97.5 %
    too. So an interval excludes 0 just where the procedure rejects 0 at a level of 5 %. What a
    verdict says about a size has the level of its own interval.
    """
    samples = {'avoidance gap': gap, 'win balance of sideslip': balance}
    margins = [rules[name]['margin'] for name in ('avoidance_gap', 'sideslip_balance')]
    levels = holm_levels([estimate(values).p for values in samples.values()])
    verdicts = []
    for (name, values), margin, level in zip(samples.items(), margins, levels):
        interval = estimate(values, 1 - level)
        verdicts.append(Verdict(name, interval, 1 - level, margin, *verdict(interval, margin)))
    return verdicts


def verdict(interval: Estimate, margin: float) -> tuple[str, int]:
    """Return the verdict on a difference MPCC less baseline, and how many replicates it lacks."""
    low, high = interval.low, interval.high
    if low > 0.0 or high < 0.0:
        small = -margin <= low and high <= margin
        size = f', by less than {100 * margin:g} points' if small else ''
        return f'{"MPCC" if low > 0.0 else "baseline"} better{size}', 0
    if -margin <= low and high <= margin:
        return 'equivalent', 0
    if math.isnan(low):
        return 'open', 0
    return 'open', math.ceil(interval.units * ((width(interval) / margin) ** 2 - 1))


def stop_rule(replicates: int, widths: Sequence[float], rules: Mapping[str, Any]) -> str:
    """Return whether the study stops, from the widths of both intervals of 95 % alone.

    `rules` are those under `stop` in a plan.
    """
    if replicates >= rules['cap']:
        return 'stop: most replicates'
    if replicates < rules['from']:
        return 'go on: fewer than the least replicates'
    wide = any(not width <= most for width, most in zip(widths, rules['widths']))
    return 'go on: an interval is too wide' if wide else 'stop: both intervals are narrow'


def width(interval: Estimate) -> float:
    """Return the width of an interval."""
    return interval.high - interval.low


def better_by(plan: Mapping[str, Any]) -> dict[str, float]:
    """Return by how much one drive is better than another, by quantity, in its unit; less ties."""
    sideslip = plan['confirmatory']['sideslip_balance']['better_by_deg']
    return {'peak_sideslip_deg': sideslip, **plan['balance']}


def _judged(drives):
    """Return the drives that judge: those of arms, and those of the factorial."""
    # drives of searches have no values of their tasks
    whole = {'stratum': int, 'latency_ms': int}
    judged = drives[drives['judged']].infer_objects().astype(whole)
    is_factorial = judged['arm'].str.startswith(FACTORIAL)
    return judged[~is_factorial], judged[is_factorial]


def _confirmatory(judged, plan):
    """Return by replicate avoidance gap and balance of sideslip, which have verdicts."""
    first, second = paired(judged, COMPARED)
    if 2 * len(first) != (judged['start'].eq(0) & judged['arm'].isin(COMPARED)).sum():
        raise BagError(f'{" and ".join(COMPARED)} were not judged on the same tasks')
    what = 'peak_sideslip_deg'
    samples = _gap(first, second), pairwise(first, second, what, better_by(plan)[what])
    return [_per_replicate(values) for values in samples]


def paired(judged: pd.DataFrame, pair: Sequence[str]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the drives of both arms in the tasks of both, with the same index."""
    rows = judged[judged['start'] == 0]
    sides = [rows[rows['arm'] == arm].set_index(['replicate', 'task']) for arm in pair]
    common = sides[0].index.intersection(sides[1].index)
    return sides[0].loc[common], sides[1].loc[common]


def pairwise(first: pd.DataFrame, second: pd.DataFrame, what: str, least: float) -> pd.Series:
    """Return per task 1 where the first arm is better by `least`, -1 where it is worse, else 0.

    Whoever does not avoid is last, so no task is left out; two that do not avoid tie. Two that
    avoid tie where one has no value, as of a car that does not brake hard.
    """
    lead = QUANTITIES[what].sign * (first[what] - second[what])
    among_avoided = (lead >= least).astype(int) - (lead <= -least).astype(int)
    both = first['avoided'] & second['avoided']
    return among_avoided.where(both, _gap(first, second).astype(int))


def limit_demand(S: np.ndarray, avoided: np.ndarray, span: tuple[float, float]) -> float:
    """Return S90, where LIMIT_SHARE is avoided: of a logistic curve in log S, fitted by likelihood.

    NaN outside the driven range `span`, and where avoidance does not fall with S.
    """
    from scipy.optimize import minimize

    x = np.log(S)
    centre = x.mean()
    terms = np.stack([np.ones_like(x), x - centre])

    def loss(weights):
        z = weights @ terms
        residual = 1.0 / (1.0 + np.exp(-z)) - avoided
        return np.logaddexp(0.0, z).sum() - z[avoided].sum(), terms @ residual

    # bounded: of arms that avoid everything below an S, and nothing above, the slope has no limit
    fit = minimize(loss, (0.0, -1.0), jac=True, method='L-BFGS-B', bounds=[(-200.0, 200.0)] * 2)
    level, slope = fit.x
    if slope >= 0.0 or not fit.success:
        return math.nan
    logarithm = centre + (math.log(LIMIT_SHARE / (1.0 - LIMIT_SHARE)) - level) / slope
    return math.exp(logarithm) if np.log(span[0]) <= logarithm <= np.log(span[1]) else math.nan


def latency_group(drives: pd.DataFrame) -> pd.Series:
    """Return the name in LATENCIES of every drive."""
    return (drives['latency_ms'].astype(str) + ' ms').where(~drives['compensated'], LATENCIES[-1])


def _gap(first, second):
    return first['avoided'].astype(float) - second['avoided'].astype(float)


def _per_replicate(values):
    return values.groupby(level='replicate').mean().to_numpy()


def _rows(name, what, groups, **more):
    """Yield an estimate for each (group, values by replicate and task)."""
    for group, values in groups:
        yield Row(name, what, str(group), estimate(_per_replicate(values)), **more)


def _shares(judged):
    drives = judged[judged['start'] == 0].set_index(['replicate', 'task'])
    for arm, rows in drives.groupby('arm', sort=False):
        groups = [('all', rows), *rows.groupby('stratum')]
        yield from _rows(arm, 'avoided', ((group, part['avoided']) for group, part in groups))


def _gaps(judged, pairs):
    for pair in pairs:
        first, second = paired(judged, pair)
        gap = _gap(first, second)
        groups = [('all', gap)]
        if pair == COMPARED:
            groups += [*gap.groupby(first['stratum']), *gap.groupby(latency_group(first))]
        yield from _rows(' - '.join(pair), 'avoided', groups)


def _limits(drives: pd.DataFrame) -> Iterator[Row]:
    """Yield S90 by arm, and its ratio: jackknife over replicates, as a replicate has few tasks."""
    span = (drives['S'].min(), drives['S'].max())

    def logarithms(part):
        """Return log S90 of both arms and the difference of them."""
        arms = (part[part['arm'] == arm] for arm in COMPARED)
        values = [
            limit_demand(*(arm[k].to_numpy() for k in ('S', 'avoided')), span) for arm in arms
        ]
        return np.log([*values, values[0] / values[1]])

    groups = latency_group(drives)
    for group in LATENCIES:
        part = drives[groups == group]
        if part.empty:
            continue
        for name, value in zip((*COMPARED, ' / '.join(COMPARED)), _jackknife(part, logarithms)):
            note = ''
            if math.isnan(value.mean):
                note = f'S90 not within {span[0]:.2f} to {span[1]:.2f}'
            elif math.isnan(value.low) and part['replicate'].nunique() > 1:
                note = 'no interval: without some replicate S90 leaves the range'
            value = value._replace(**{k: math.exp(getattr(value, k)) for k in value._fields[:3]})
            yield Row(name, 'ratio' if '/' in name else 'S90', group, value, '', note)


def _jackknife(rows: pd.DataFrame, statistic: Callable) -> list[Estimate]:
    """Return each number of a statistic with its interval from replicates (Tukey 1958)."""
    whole, names = statistic(rows), rows['replicate'].unique()
    if len(names) < 2:
        return [Estimate(value, math.nan, math.nan, 1) for value in whole]
    without = np.array([statistic(rows[rows['replicate'] != name]) for name in names])
    estimates = [estimate(pseudo) for pseudo in (len(names) * whole - (len(names) - 1) * without).T]
    # of replicates without which S90 leaves the range nothing may be left out: no interval
    known = np.isfinite(without).all(axis=0) & np.isfinite(whole)
    return [
        interval._replace(mean=value) if all_known else Estimate(value, math.nan, math.nan)
        for interval, value, all_known in zip(estimates, whole, known)
    ]


def _losses(drives: pd.DataFrame) -> Iterator[Row]:
    """Yield the avoidance lost: least squares within a replicate, with a level per stratum."""
    names = (HIGH, LOW, LATENCY, KNOWN_LATENCY)
    slopes: dict[str, list[np.ndarray]] = {arm: [] for arm in COMPARED}
    for _, replicate in drives.groupby('replicate'):
        for arm, rows in replicate.groupby('arm'):
            error, known = rows['friction_error'], rows['compensated']
            terms = np.column_stack(
                [
                    *(error.clip(lower=0.0) / 0.05, -error.clip(upper=0.0) / 0.05),
                    *((rows['latency_ms'] / 25.0).where(~known, 0.0), known),
                    pd.get_dummies(rows['stratum']),
                ]
            ).astype(float)
            fit, _, rank, _ = np.linalg.lstsq(terms, rows['avoided'].astype(float))
            usable = rank == terms.shape[1]
            slopes[arm].append(-fit[: len(names)] if usable else np.full(len(names), np.nan))
    arrays = {arm: np.array(values) for arm, values in slopes.items()}
    arrays[DIFFERENCE] = arrays[COMPARED[0]] - arrays[COMPARED[1]]
    for arm, values in arrays.items():
        for name, column in zip(names, values.T):
            yield Row(arm, 'avoidance lost', name, estimate(column))


def _balances(judged, pair, plan):
    first, second = paired(judged, pair)
    for what in QUANTITIES:
        result = pairwise(first, second, what, better_by(plan)[what])
        note = ''
        silent = first['avoided'] & second['avoided'] & (first[what].isna() | second[what].isna())
        if silent.any():
            note = f'{silent.sum()} of {len(silent)} tasks tie because an arm has no value'
        gap = _gap(first, second)
        shares = (
            *(('balance', result), ('better', result == 1), ('worse', result == -1)),
            # parts of the balance: one arm avoids, or both do
            *(('by avoidance', gap), ('where both avoid', result - gap)),
        )
        yield from _rows(' - '.join(pair), what, shares, note=note)


def _effects(factorial: pd.DataFrame) -> Iterator[Row]:
    """Yield main effects and interactions of two factors, within the tasks that have all values.

    Not of avoidance: the tasks were chosen as those that the MPCC avoids.

    An effect is the mean of the eight drives with the factor as the baseline has it less that of
    the other eight; an interaction is half of what the effect of a factor gains by the other
    factor. Intervals are over replicates, of a single replicate over its tasks.
    """
    if factorial.empty:
        return
    arms = [f'factorial:{k:04b}' for k in range(16)]
    signs = np.array([[1.0 if digit == '1' else -1.0 for digit in arm[-4:]] for arm in arms])
    wanted = [(k,) for k in range(4)] + [*combinations(range(4), 2)]
    contrasts = np.array([signs[:, list(k)].prod(axis=1) / 8 for k in wanted])
    # a drive that ends early has no values to compare
    drives = factorial.assign(
        **{what: factorial[what].where(factorial['avoided']) for what in QUANTITIES}
    )
    for what in QUANTITIES:
        table = drives.pivot(index=['replicate', 'task'], columns='arm', values=what)[arms]
        tasks, table = len(table), table.astype(float).dropna()
        effects = pd.DataFrame(table.to_numpy() @ contrasts.T, index=table.index)
        if factorial['replicate'].nunique() > 1:
            effects = effects.groupby(level='replicate').mean()
        for numbers, values in zip(wanted, effects.to_numpy().T):
            name = ' x '.join(FACTORS[k] for k in numbers)
            yield Row(
                *(name, what, 'interaction' if len(numbers) == 2 else 'effect'),
                *(estimate(values), what.rpartition('_')[2], f'{len(table)} of {tasks} tasks'),
            )


def _unsteady(judged):
    several = judged.groupby(['arm', 'replicate', 'task'], sort=False)['avoided'].agg(
        ['nunique', 'size']
    )
    several = several[several['size'] > 1]
    for arm, rows in (several['nunique'] > 1).groupby(level='arm', sort=False):
        yield from _rows(arm, 'starts disagree', [('all', rows)])


def to_text(results: Results) -> str:
    """Return everything as lines for a terminal; points as such, other units as they are."""
    lines = [f'{results.stop}', '', 'MPCC as in the paper, without the heading in its cost:']
    for item in results.verdicts:
        more = f'; {item.more} more replicates would decide' if item.more else ''
        lines.append(
            f'{item.hypothesis}: {item.text}{more} ({_interval(item.estimate, POINTS)}, '
            f'{100 * item.confidence:g} % over {item.estimate.units} replicates, which scatter by '
            f'{100 * item.estimate.scatter:.1f}; margin {100 * item.margin:g})'
        )
    heading = [row for row in results.gaps if row.name == HEADING_DIFFERENCE and row.group == 'all']
    lines += [
        f'with the heading in its cost, too: MPCC less baseline {_interval(row.estimate, POINTS)}, '
        'an estimate without a verdict'
        for row in heading
    ]
    for name, rows in zip(results._fields[2:], results[2:]):
        lines += ['', name]
        for row in rows:
            numbers = _interval(row.estimate, row.unit)
            line = f'  {row.name:24}{row.what:20}{row.group:32}{numbers:28}{row.note}'
            lines.append(line.rstrip())
    return '\n'.join(lines)


def _interval(item, unit):
    factor, digits = (100, 1) if unit == POINTS else (1, 3)
    mean, low, high = (factor * value for value in item[:3])
    return f'{mean:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}] {unit}'.rstrip()
