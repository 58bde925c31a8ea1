"""`experiments resolve`: one recorded tick, solved again, changed, and its sensitivities.

Which tick is meant is said by a time, a station, or what happens there.
"""

from typing import NamedTuple

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from bags.errors import BagError
from bags.evaluation.drive import drive_from_columns
from bags.evaluation.metrics import outcome
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.storage import read
from bags.storage.invalid_messages import drop_invalid
from experiments.configuration.set_option import Changes
from experiments.replay import (
    EVENTS,
    LEAD_S,
    LOSS,
    check,
    recorded_problem,
    recorded_ticks,
    replayed_controller,
)
from experiments.replay.check import COMMAND_UNITS, Pair
from experiments.replay.recorded_problem import Problem, Solved
from experiments.replay.recorded_ticks import Tick

HEADS = ('solved again', 'changed')  # the problem as recorded, and with what --set changes
STEP = 1e-3  # relative, of a weight: a difference of 1e-6 is then known to about 1e-4
TOLERANCE = 1e-10  # of the solver, for sensitivities
NS = 1e-9  # s
MM = 1e3
PERCENT = 0.01
UNITS = {
    'delta': 'rad', 'Fx': 'N', 'd_delta': 'rad/s', 'd_Fx': 'N/s', 'lambda_b': '-', 'slack': 'm',
    'front': 'of mu Fz', 'rear': 'of mu Fz', 'total': 'of mu Fz', 'track': 'm', 'speed': 'm/s',
}  # fmt: skip


class ChosenTick(NamedTuple):
    """A tick and where it is."""

    number: int
    t: float  # s since the first tick
    station: float  # m
    because: str  # what is there, '' for a tick that was named by time or station

    def __str__(self) -> str:
        because = f': {self.because}' if self.because else ''
        return f'tick {self.number} at {self.t:.2f} s, station {self.station:.1f} m{because}'


def choose(
    bag: read.Bag,
    *,
    time: float | None = None,
    station: float | None = None,
    event: str | None = None,
) -> ChosenTick:
    """Return the tick that is meant: the last one that is not behind the moment.

    Given is one of: `time` [s] since the first tick, `station` [m] along the reference, `event`,
    one of EVENTS. Raises BagError for a moment that the recording does not have.
    """
    stamps = np.array([tick.stamp_ns for tick in recorded_ticks.read_ticks(bag)])
    t = (stamps - stamps[0]) * NS
    columns = read.columns(drop_invalid(bag), recorded_ticks.NEEDED)
    run = EvaluatedDrive(drive_from_columns(columns, bag.run_info, str(bag.path)))
    stations, because = run.station_at(stamps), ''

    def last_until(stamp_ns):
        return max(int(np.searchsorted(stamps, stamp_ns, side='right')) - 1, 0)

    if time is not None:
        _check(bag, 'time', time, 0.0, t[-1], 's')
        # a time as text may be a rounding below that of its tick
        number = int(np.searchsorted(t, time + 1e-6, side='right')) - 1
    elif station is not None:
        _check(bag, 'station', station, stations[0], stations.max(), 'm')
        number = max(int(np.argmax(stations > station)) - 1, 0)
    elif event == 'fallback':
        (rows,) = np.nonzero(run.drive.ticks.fallback)
        if not rows.size:
            raise BagError(f'{bag.path}: every tick followed a fresh plan')
        number, because = int(rows[0]), EVENTS[event]
    elif event == LOSS:
        losses = outcome.find_losses(run)
        if not losses:
            raise BagError(
                f'{bag.path}: the car neither collided nor left the road nor slid; --at closest '
                'shows the least distance to an obstacle'
            )
        row, what = losses[0]
        number = last_until(run.stamp_ns[row] - LEAD_S / NS)
        lead = (run.stamp_ns[row] - stamps[number]) * NS
        because = f'{lead:.1f} s before station {run.series.station[row]:.0f} m, where it {what}'
    else:
        row, because = _extreme(bag, event, run.series)
        number = last_until(run.stamp_ns[row])
    return ChosenTick(number, float(t[number]), float(stations[number]), because)


def _check(bag, what, value, low, high, unit):
    if not low <= value <= high:
        raise BagError(
            f'{bag.path}: no tick at {what} {value:g} {unit}; it has {low:g} to {high:g} {unit}'
        )


def _extreme(bag, event, series):
    """Return the row of the series at an event, and what is there."""
    if event == 'sideslip':
        angle = np.degrees(np.abs(np.nan_to_num(series.sideslip)))
        row = int(np.argmax(angle))
        return row, f'{EVENTS[event]}, {angle[row]:.1f} deg'
    gaps = series.v2o if event == 'closest' else series.v2e
    known = {name: gap for name, gap in gaps.items() if np.any(np.isfinite(gap))}
    if not known:
        raise BagError(f'{bag.path}: there is no obstacle')
    name = min(known, key=lambda name: np.nanmin(known[name]))
    row = int(np.nanargmin(known[name]))
    which = f'to obstacle {name}' if event == 'closest' else f'to the {name} edge'
    return row, f'least distance {which}, {known[name][row]:.2f} m'


class Sensitivity(NamedTuple):
    """The sensitivity to one weight, per relative change of it: times 0.01 for one percent."""

    weight: str
    value: float
    cost: float  # d J / d ln w: the term itself (envelope theorem)
    cost_difference: float  # the same by central differences, as a check
    v2o: float  # m, d min D_V2O / d ln w, by central differences; NaN without obstacles


class PosedTick(NamedTuple):
    """A tick with its problem."""

    tick: Tick
    problem: Problem
    chain: int  # earlier ticks with another answer than recorded: they change the warm start


class Answer(NamedTuple):
    """The result for one tick."""

    name: str  # of the controller
    tick: Tick
    command: tuple[Pair, ...]  # recorded, and solved again; empty where it was lost
    chain: int  # see PosedTick
    solved: Solved
    changed: Solved | None
    sensitivities: tuple[Sensitivity, ...]

    @property
    def is_same(self) -> bool:
        """Whether solving again gives the recorded command."""
        return not any(pair.differs for pair in self.command)

    @property
    def both(self) -> tuple[Solved, ...]:
        """The tick as it was, and changed if that was requested."""
        return (self.solved, self.changed) if self.changed else (self.solved,)


def pose(bag: read.Bag, number: int) -> PosedTick:
    """Return a tick and the problem that was solved for it.

    The plan of the tick before, which is the initial guess and warm start, is not recorded; it is
    computed by answering all earlier ticks. Raises BagError for a tick that the bag does not have
    and for one without a problem.
    """
    ticks = recorded_ticks.read_ticks(bag, number + 1)
    if not 0 <= number < len(ticks):
        count = len(recorded_ticks.read_ticks(bag))
        raise BagError(f'{bag.path}: there is no tick {number}; it has 0 to {count - 1}')
    controller = replayed_controller.from_run_info(bag.run_info, {}, str(bag.path))
    before = check.compare_ticks(ticks[:number], controller)
    chain = sum(bool(compared.differing) for compared in before)
    return PosedTick(ticks[number], recorded_problem.pose(controller, ticks[number]), chain)


def answer(
    bag: read.Bag, posed: PosedTick, changes: Changes, with_sensitivities: bool = False
) -> Answer:
    """Solve a posed tick as it was and changed; BagError for changes that are not possible."""
    tick, problem, chain = posed
    solved, changed = problem.solve(), None
    parameters, factors = changes
    if parameters or factors:
        other = problem
        if parameters:
            in_force = tick.inputs.changes | parameters
            params = replayed_controller.recorded_params(bag.run_info, in_force, str(bag.path))
            other = problem.with_params(*params)
        changed = other.scale_weights(factors).solve()
    return Answer(
        bag.run_info.get('controller', 'controller'),
        tick,
        tuple(check.pair_commands(tick.command, solved.command)) if tick.command else (),
        chain,
        solved,
        changed,
        find_sensitivities(problem) if with_sensitivities else (),
    )


def find_sensitivities(problem: Problem) -> tuple[Sensitivity, ...]:
    """Return the sensitivities of cost and least distance to every weight that is not zero.

    Central differences between solves to 1e-10 of the cost that start from the solution. Raises
    BagError when a solve fails.
    """
    precise = problem.with_tolerance(TOLERANCE)
    solution = _solve(precise)
    start = precise.start_from(solution)
    step = np.log1p(STEP) - np.log1p(-STEP)
    sensitivities = []
    for name, weight in start.weights.items():
        if weight:
            less, more = (_solve(start.scale_weights({name: 1 + s * STEP})) for s in (-1, 1))
            cost, v2o = more.cost - less.cost, more.least_v2o - less.least_v2o
            sensitivities.append(
                Sensitivity(name, weight, solution.terms[name], cost / step, v2o / step)
            )
    return tuple(sensitivities)


def _solve(problem: Problem) -> Solved:
    solved = problem.solve()
    if not solved.is_feasible:
        raise BagError(f'sensitivities: a neighbouring problem was not solved: {solved.status}')
    return solved


def show(answer: Answer, console: Console) -> None:
    """Print commands, cost, distances, active limits and sensitivities as tables."""
    tick = answer.tick
    head = f'{answer.name}, tick {tick.number} at {tick.t_s:.2f} s'
    console.print(f'{head}: recorded {tick.why.message}', markup=False, highlight=False)
    for label, solved in zip(HEADS, answer.both):
        end = f'{solved.status} after {solved.iterations} iterations'
        console.print(f'{label}: {end}', highlight=False)
    console.print(_verdict(answer), highlight=False)
    tables = [_commands, _terms, _distances, _limits]
    for table in [*tables, _sensitivities] if answer.sensitivities else tables:
        console.print()
        console.print(table(answer))


def _verdict(answer):
    if not answer.command:
        return '[yellow]its command was not recorded[/]'
    if answer.is_same:
        return '[green]the command is the recorded one[/]'
    reasons, why = [*answer.tick.gaps], answer.tick.why.values
    if why.get('gate', 'passed') != 'passed':
        reasons.append('the gate turned it back')
    if why.get('rung') in ('shifted', 'recovery', 'braking'):
        reasons.append('the plan of this tick was not followed')
    if answer.chain:
        reasons.append(f'{answer.chain} ticks before it are answered differently')
    because = f': {"; ".join(reasons)}' if reasons else ''
    return f'[red]the command is not the recorded one[/]{because}'


def _table(title, *columns, caption=None):
    look = {'box': box.SIMPLE_HEAD, 'show_edge': False, 'pad_edge': False, 'caption': caption}
    table = Table(title=title, title_justify='left', caption_justify='left', **look)
    for i, name in enumerate(columns):
        table.add_column(name, justify='right' if i else 'left', no_wrap=True)
    return table


def _heads(answer):
    return [head for head, _ in zip(HEADS, answer.both)]


def _commands(answer):
    table = _table('command', '', 'unit', 'recorded', *_heads(answer))
    commands = [answer.tick.command, *(solved.command for solved in answer.both)]
    for name, unit in COMMAND_UNITS.items():
        cells = (f'{getattr(command, name):.6g}' if command else '–' for command in commands)
        table.add_row(name, unit, *cells)
    return table


def _terms(answer):
    columns = ['weight', 'value', 'share']
    if answer.changed:
        columns += [f'{column}\nchanged' for column in columns]
    caption = 'value: weight x squared error, summed over the horizon; share: of the cost'
    table = _table('cost of the plan', 'term', *columns, caption=caption)
    for name in dict.fromkeys(name for solved in answer.both for name in solved.terms):
        table.add_row(name, *(cell for solved in answer.both for cell in _term(solved, name)))
    table.add_section()
    sums = (('', f'{solved.cost:.4f}', '100 %') for solved in answer.both)
    table.add_row('sum', *(cell for cells in sums for cell in cells))
    return table


def _term(solved, name):
    """Return weight, value and share of the cost of a term."""
    value, weight = solved.terms.get(name), solved.weights.get(name)
    share = '–' if value is None or not solved.cost else f'{100 * value / solved.cost:.0f} %'
    texts = ('–' if n is None else f'{n:{form}}' for n, form in ((weight, '.4g'), (value, '.4f')))
    return *texts, share


def _distances(answer):
    caption = (
        'at a stage: so many steps of the prediction ahead; inside: nearer than the safety distance'
    )
    table = _table('least distance of the plan', 'to', *_heads(answer), caption=caption)
    by_name = [{d.name: d for d in solved.distances} for solved in answer.both]
    for name in dict.fromkeys(name for distances in by_name for name in distances):
        table.add_row(name, *(_least_distance(distances.get(name)) for distances in by_name))
    return table


def _least_distance(distance):
    if distance is None:
        return '–'
    (inside,) = np.nonzero(distance.safe > distance.D)
    stages = f', inside {inside[0]}–{inside[-1]}' if len(inside) else ''
    return f'{np.min(distance.D):.3f} m at {int(np.argmin(distance.D))}{stages}'


def _limits(answer):
    columns = ('limit', 'value', 'unit', 'at stages', 'multiplier')
    caption = 'multiplier: cost saved per SI unit by which the limit is relaxed, the largest'
    table = _table('limits in force', *columns, caption=caption)
    for label, solved in zip(_heads(answer), answer.both):
        for limit in solved.active:
            stages = f'{limit.first}–{limit.last}' if limit.last > limit.first else f'{limit.first}'
            what, unit = f'{limit.side} limit of {limit.quantity}', UNITS.get(limit.quantity, '')
            force = f'{limit.multiplier:.3g} at {limit.at}'
            table.add_row(f'{label}: {what}', f'{limit.limit:.4g}', unit, stages, force)
        if not solved.active:
            table.add_row(f'{label}: none')
    return table


def _sensitivities(answer):
    columns = ('term', 'weight', 'cost', 'by differences', 'obstacle distance, mm')
    table = _table('what changes when a weight grows by one percent', *columns)
    for entry in answer.sensitivities:
        costs = (f'{PERCENT * cost:+.6f}' for cost in (entry.cost, entry.cost_difference))
        v2o = '–' if np.isnan(entry.v2o) else f'{PERCENT * MM * entry.v2o:+.4f}'
        table.add_row(entry.weight, f'{entry.value:.4g}', *costs, v2o)
    return table
