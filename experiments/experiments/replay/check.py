"""`experiments replay-check`: are recorded ticks answered as recorded, within tolerances?

Only times are exempt. Numbers are in SI units. On one machine a replay gives the same bits; another
instruction set rounds differently, by less than 1e-10 of these tolerances' units (docs/replay.md).
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from bags.command_line import table
from bags.errors import BagError
from bags.storage import read
from bags.storage.columns import DECODE_ERRORS, decode_message
from experiments.configuration.inputs import ESTIMATOR
from experiments.replay import recorded_ticks, replayed_controller
from experiments.replay.recorded_ticks import BELIEVED, Tick
from experiments.replay.replayed_controller import ReplayedController
from msgs_yaml import conversions
from msgs_yaml.types import Command, EstimatedState, Prediction, SensorReading, StopPlan, Why
from node_runtime import parameters
from state_estimator.estimators import Stream
from state_estimator.parameters import EstimatorParams
from vehicle_plant.sensors import TOPICS

COMMAND_TOLERANCE = 1e-6  # rad, rad/s, N
VALUE_TOLERANCE = 1e-6  # of max(1, |recorded|), for all other numbers
# times of the wall and of threads, which are not repeatable
EXEMPT, EXEMPT_END = 'time.', '.cpu_ms'
ABSENT = 'absent'
COMMAND_UNITS = {'delta': 'rad', 'd_delta': 'rad/s', 'Fxf': 'N', 'Fxr': 'N'}
POSES, SET_POINTS = ('X', 'Y', 'psi'), ('t', 'delta', 'Fxf', 'Fxr')
GROUPS = ('command', 'cost', 'prediction', 'stop_plan', 'other')
# a tick that cannot be repeated changes the warm start of the following ones; after so many ticks
# its effect is gone, and a difference counts again
SHADOW = 20
MAX_FIELDS = 12  # shown of the first differing tick


class Pair(NamedTuple):
    """One field of a tick, recorded and replayed."""

    field: str  # command.delta, cost.con, prediction.X, estimate.vy
    recorded: float | int | str | bool
    replayed: float | int | str | bool
    tolerance: float

    @property
    def difference(self) -> float:
        """The absolute difference; infinite for different words, 0 for the same."""
        if self.recorded == self.replayed:
            return 0.0
        if isinstance(self.recorded, str) or isinstance(self.replayed, str):
            return np.inf
        difference = abs(float(self.recorded) - float(self.replayed))
        return np.inf if np.isnan(difference) else difference

    @property
    def differs(self) -> bool:
        """Whether the difference exceeds the tolerance."""
        return self.difference > self.tolerance


class ComparedTick(NamedTuple):
    """One tick, recorded and replayed."""

    tick: Tick
    pairs: tuple[Pair, ...]
    gap: str  # the reason why a difference is no failure, '' for none

    @property
    def differing(self) -> tuple[Pair, ...]:
        """The fields beyond their tolerances."""
        return tuple(pair for pair in self.pairs if pair.differs)


class Report(NamedTuple):
    """The result of a check."""

    name: str  # of the bag
    run_info: Mapping[str, str]
    ticks: tuple[ComparedTick, ...]

    @property
    def failures(self) -> tuple[ComparedTick, ...]:
        """The repeatable ticks that differ."""
        return tuple(tick for tick in self.ticks if tick.differing and not tick.gap)

    @property
    def repeatable(self) -> int:
        """The number of repeatable ticks."""
        return sum(not tick.gap for tick in self.ticks)


def check(bag: read.Bag, settings: Mapping[str, Any]) -> Report:
    """Replay a recording through today's controller with the parameters of the run, and compare.

    `settings` change parameters by dotted name. Every tick starts from the recorded state and
    set-points; its warm start is the plan of the tick before in this replay. An estimator is
    replayed from the messages of the sensors, in lockstep. Raises BagError for a bag that cannot be
    replayed.
    """
    name = str(bag.path)
    controller = replayed_controller.from_run_info(bag.run_info, settings, name)
    compared = compare_ticks(recorded_ticks.read_ticks(bag), controller)
    if all(tick.gap for tick in compared):
        raise BagError(f'{name}: no tick can be repeated: {compared[0].gap}')
    estimates = replay_estimates(bag)
    compared = tuple(
        answer._replace(pairs=(*answer.pairs, *pair_estimates(*estimates[answer.tick.stamp_ns])))
        if answer.tick.stamp_ns in estimates
        else answer
        for answer in compared
    )
    return Report(name, bag.run_info, compared)


def replay_estimates(bag: read.Bag) -> dict[int, tuple[EstimatedState, EstimatedState]]:
    """Return (recorded, replayed) estimates by stamp [ns], {} of a run without an estimator.

    Nor of a run on the wall clock, of which messages may be lost. Raises BagError for parameters
    that today's estimator refuses.
    """
    noted = json.loads(bag.run_info.get('parameters', '{}')).get(ESTIMATOR)
    if noted is None or bag.run_info.get('mode') != read.LOCKSTEP:
        return {}
    own = {name: noted[name] for name in parameters.leaves(EstimatorParams) if name in noted}
    params = parameters.build(EstimatorParams, own, lambda name: str(bag.path))
    stream, replayed = Stream(params), {}
    for message in _in_order(bag):
        believed = stream.take(message)
        if believed:
            replayed[believed.state.stamp_ns] = believed.as_message()
    recorded = {x.stamp_ns: x for x in read.values(bag, BELIEVED)}
    return {ns: (recorded[ns], replayed[ns]) for ns in recorded.keys() & replayed.keys()}


def _in_order(bag: read.Bag) -> Iterator[SensorReading]:
    """Yield the valid messages of the sensors in the order in which they were sent."""
    sent = []
    for name in TOPICS:
        recorded = read.recording(bag, name)
        rows = zip(recorded.publish_ns.tolist(), recorded.payloads)
        sent += [(ns, recorded.topic, payload) for ns, payload in rows]
    for _, topic, payload in sorted(sent, key=lambda row: row[0]):
        try:
            yield decode_message(topic, payload)
        except DECODE_ERRORS:
            continue


def compare_ticks(
    ticks: Sequence[Tick], controller: ReplayedController
) -> tuple[ComparedTick, ...]:
    """Answer ticks one after the other, each continued from the recorded command; compare each."""
    compared, shadow, cause = [], 0, ''
    for tick in ticks:
        if tick.inputs.actuators is not None:
            shadow = 0  # a restart: the warm start is gone
        if tick.gaps:
            shadow, cause = SHADOW, tick.gaps[0]
        command, prediction, why, stop = controller.step(tick.inputs, tick.stamp_ns)
        pairs = [*pair_reports(tick.why, why)]
        if tick.command is not None:
            pairs[:0] = pair_commands(tick.command, command)
            controller.continue_from(tick.command)
        if tick.prediction is not None:
            pairs += pair_stages('prediction', POSES, tick.prediction, prediction)
        if tick.stop is not None:
            pairs += pair_stages('stop_plan', SET_POINTS, tick.stop, stop)
        compared.append(ComparedTick(tick, tuple(pairs), cause if shadow else ''))
        shadow = max(shadow - 1, 0)
    return tuple(compared)


def pair_commands(recorded: Command, replayed: Command) -> Iterator[Pair]:
    """Yield the numbers of two commands."""
    for name in COMMAND_UNITS:
        values = getattr(recorded, name), getattr(replayed, name)
        yield Pair(f'command.{name}', *values, COMMAND_TOLERANCE)


def pair_reports(recorded: Why, replayed: Why) -> Iterator[Pair]:
    """Yield every value of two reports except times; a missing value is ABSENT."""
    for name in recorded.values | replayed.values:
        if not (name.startswith(EXEMPT) or name.endswith(EXEMPT_END)):
            values = recorded.values.get(name, ABSENT), replayed.values.get(name, ABSENT)
            yield Pair(name, *values, _tolerance(values[0]))


def pair_stages(
    group: str,
    names: Sequence[str],
    recorded: Prediction | StopPlan,
    replayed: Prediction | StopPlan | None,
) -> Iterator[Pair]:
    """Yield columns of two plans, each at the stage of the largest difference; None has none."""
    counts = [0 if plan is None else len(plan[1]) for plan in (recorded, replayed)]
    if counts[0] != counts[1]:
        yield Pair(f'{group}.stages', *counts, 0.0)
        return
    for name in names if counts[0] else ():
        before, after = getattr(recorded, name), getattr(replayed, name)
        stage = int(np.argmax(np.abs(before - after)))
        values = float(before[stage]), float(after[stage])
        yield Pair(f'{group}.{name}', *values, _tolerance(values[0]))


def pair_estimates(recorded: EstimatedState, replayed: EstimatedState) -> Iterator[Pair]:
    """Yield the numbers of two estimates, covariances among them; a turn of pi is none."""
    for name, before, after in zip(recorded._fields[1:], recorded[1:], replayed[1:]):
        if name == 'psi':
            after = before + conversions.wrap_angle(after - before)
        yield Pair(f'estimate.{name}', before, after, _tolerance(before))


def _tolerance(value):
    return 0.0 if isinstance(value, str) else VALUE_TOLERANCE * max(1.0, abs(value))


def largest_differences(report: Report) -> dict[str, tuple[float, int]]:
    """Return per group of fields the largest difference of repeatable ticks, and its tick.

    The groups: command, cost, prediction, stop_plan, and the rest, also of estimates. All but the
    first differences are relative to max(1, |recorded|); words count when they differ.
    """
    largest = dict.fromkeys(GROUPS, (0.0, 0))
    for compared in report.ticks:
        for pair in compared.pairs if not compared.gap else ():
            group = pair.field.partition('.')[0]
            group = group if group in largest else 'other'
            scale = 1.0 if isinstance(pair.recorded, str) else max(1.0, abs(pair.recorded))
            size = pair.difference if group == 'command' else pair.difference / scale
            if size > largest[group][0]:
                largest[group] = (size, compared.tick.number)
    return largest


def show(report: Report, console: Console) -> None:
    """Print how many ticks agree, the first tick that differs, and the ticks with gaps."""
    controller, mode = (report.run_info.get(key, 'unknown') for key in ('controller', 'mode'))
    console.print(f'{report.name}: {controller}, {mode}', markup=False, soft_wrap=True)
    count = f'{len(report.ticks)} ticks'
    if report.repeatable < len(report.ticks):
        count = f'{report.repeatable} of {count}, the others cannot be repeated exactly'
    if report.failures:
        first = report.failures[0]
        console.print(
            f'  [red]differs[/] in {len(report.failures)} of {count}; first in tick '
            f'{first.tick.number} at {first.tick.t_s:.2f} s:'
        )
        rows = []
        for pair in first.differing[:MAX_FIELDS]:
            group, _, name = pair.field.partition('.')
            unit = f' [dim]{COMMAND_UNITS[name]}[/]' if group == 'command' else ''
            sides = (pair.recorded, pair.replayed)
            values = (v if isinstance(v, str) else f'{v:.9g}' for v in sides)
            difference = '' if pair.difference == np.inf else f'{pair.difference:.1e}'
            allowed = f'{pair.tolerance:.1e}' if pair.tolerance else ''
            rows.append((f'{pair.field}{unit}', *values, difference, allowed))
        columns = ('field', 'recorded', 'replayed', 'difference', 'allowed')
        console.print(table(columns, rows, no_wrap=True))
        rest = len(first.differing) - MAX_FIELDS
        if rest > 0:
            console.print(f'  and {rest} more fields')
    else:
        console.print(f'  [green]the same[/] in {count}')
    for group, (size, tick) in largest_differences(report).items():
        at = f' (tick {tick})' if size else ''
        console.print(f'  largest difference, {group}: {size:.1e}{at}', highlight=False)
    causes = Counter(tick.gap for tick in report.ticks if tick.gap)
    if causes:
        console.print('  not repeatable, at or soon after')
    for cause, n in causes.items():
        differing = sum(tick.gap == cause and bool(tick.differing) for tick in report.ticks)
        text = f'    {cause}: {n} ticks, {differing} differ'
        console.print(text, markup=False, highlight=False)
