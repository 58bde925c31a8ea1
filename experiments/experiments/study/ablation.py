"""Which factor does what: single switches on the MPCC's states, the baseline, over a sweep."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import (
    approach,
    case,
    penalty,
    provenance,
    run_verdicts,
    samples,
    statistics,
    tables,
    variants,
)
from experiments.study.distributions import POINT_KPH, RUNS, at_speed
from experiments.study.drives import Drives, Record
from experiments.study.quantities import BY_NAME
from experiments.study.variants import SCENARIO, SWITCHES, Variant

SPEEDS_KPH = tuple(60.0 + 5.0 * step for step in range(8))  # 60 .. 95
CLEARANCES_M = (0.3, 0.5, 0.7)  # D_sft,O: the clearance that is asked for
SWEEP_RUNS = 3  # per speed and clearance
STEM = 'ablation'
SWITCHES_STEM = 'ablation_switches'
POINT = 'operating point'
FRAMES = {'cartesian': variants.BASE, 'path': 'path lag gaussian'}


class Cell(NamedTuple):
    """One place of the sweep."""

    clearance_m: float
    speed_kph: float

    @property
    def name(self) -> str:
        """The name by which its drives are called."""
        return f'{self.speed_kph:g} km/h, D_sft {self.clearance_m:g} m'


class Ablation(NamedTuple):
    """What was driven."""

    variants: list[Variant]
    point: Mapping[str, list[Record]]  # by row, one record per draw, at the operating point
    sweep: Mapping[Cell, Mapping[str, list[Record]]]
    intrusions: penalty.Intrusions
    frames: Mapping[str, list[approach.Seen]]  # by frame of the distances
    rows: list[dict[str, Any]]  # one per cell and row
    switches: list[dict[str, Any]]  # see run_verdicts.flips; at the point, then over the sweep
    files: list[Path]


def run(
    drives: Drives,
    out: Path,
    runs: int = RUNS,
    sweep_runs: int = SWEEP_RUNS,
    speeds_kph: Sequence[float] = SPEEDS_KPH,
    clearances_m: Sequence[float] = CLEARANCES_M,
    tuned: Iterable[Path] = (),
    roles: Mapping[str, str] = variants.ROLES,
    scenario: str = SCENARIO,
    seed: int = samples.SEED,
) -> Ablation:
    """Drive `runs` draws per row at the operating point and `sweep_runs` in every cell of a sweep.

    The factors are switched on those who play the `roles`; the other plain and tuned controllers
    are rows as they are, by default all in mpcc_controller/config, else those of `tuned`.
    Writes ablation.md, .csv, .json, ablation_switches likewise, and a figure per clearance.
    Raises BagError.
    """
    from experiments.study import ablation_figure

    chosen = [*variants.ablation(roles, scenario), *variants.others(roles, tuned)]
    point = at_speed(drives, chosen, POINT_KPH, samples.draws(runs, seed), scenario)
    draws = samples.draws(sweep_runs, seed)
    sweep = {}
    for clearance in clearances_m:
        for kph in speeds_kph:
            cell = Cell(clearance, kph)
            sweep[cell] = _driven(drives, chosen, cell, draws, scenario)
    by_name = {one.name: one for one in chosen}
    drawn = {
        frame: approach.drive(by_name[name], POINT_KPH, scenario) for frame, name in FRAMES.items()
    }
    intrusions = penalty.planned(drawn['cartesian'])
    frames = {frame: approach.seen(one) for frame, one in drawn.items()}
    found = provenance.of(
        'experiments study ablation',
        scenario,
        seed,
        {one.name: one.controller for one in variants.cast(roles)},
        runs=runs,
        sweep_runs=sweep_runs,
        speeds_kph=list(speeds_kph),
        clearances_m=list(clearances_m),
        equal_penalty={'share_of_P_k': variants.EQUAL_PENALTY, **intrusions._asdict()},
        frames={frame: [one._asdict() for one in seen] for frame, seen in frames.items()},
    )
    rows = [_row(POINT, POINT_KPH, None, name, point[name]) for name in point]
    rows += [
        _row('sweep', cell.speed_kph, cell.clearance_m, name, records[name])
        for cell, records in sweep.items()
        for name in records
    ]
    switches = _switched(point, sweep)
    title = 'Ablation: one factor at a time'
    files = tables.write(out, STEM, title, rows, _told(rows, intrusions, frames), found)
    title = 'Which single switch turns which verdict'
    files += tables.write(out, SWITCHES_STEM, title, switches, _switches_told(switches), found)
    files += ablation_figure.write(rows, out)
    return Ablation(chosen, point, sweep, intrusions, frames, rows, switches, files)


def _driven(drives, chosen, cell, draws, scenario):
    cases = [
        case.of(one, cell.speed_kph, draw, scenario, safety__obstacle_m=cell.clearance_m)
        for draw in draws
        for one in chosen
    ]
    records = drives.of(cases, cell.name)
    return {one.name: records[k :: len(chosen)] for k, one in enumerate(chosen)}


def _row(where, kph, clearance, name, runs):
    def over(quantity):
        return statistics.summary([run.value(quantity) for run in runs])

    success = statistics.share([run_verdicts.cleared(run) for run in runs])
    onset, hard = over('brake_onset_at_m'), over('brake_onset_hard_at_m')
    v2o, slip = over('min_v2o_m'), over('peak_sideslip_deg')
    return {
        'where': where,
        'speed_kph': kph,
        'clearance_m': clearance,
        'row': name,
        'runs': len(runs),
        'cleared': success.share,
        'cleared_low': success.low,
        'cleared_high': success.high,
        'min_v2o_m': v2o.median,
        'min_v2o_least_m': v2o.least,
        'peak_sideslip_deg': slip.median,
        'peak_sideslip_most_deg': slip.most,
        'brake_onset_at_m': onset.median,
        'braking_runs': onset.runs,
        'brake_onset_hard_at_m': hard.median,
        'hard_braking_runs': hard.runs,
        'min_speed_mps': over('min_speed_mps').median,
        'iterations_mean': over('solver.iterations_mean').median,
    }


def _switched(point, sweep):
    cells = {cell.name: records for cell, records in sweep.items()}
    found = []
    for where, chosen in ((POINT, {f'{POINT_KPH:g} km/h': point}), ('sweep', cells)):
        for switch in SWITCHES:
            found += [{'where': where, **row} for row in run_verdicts.flips(switch, chosen)]
    return found


def _told(rows, intrusions, frames):
    shown = ('min_v2o_m', 'peak_sideslip_deg', 'brake_onset_at_m', 'brake_onset_hard_at_m')
    header = ['row', 'runs', 'cleared', *(f'{BY_NAME[n].title} [{BY_NAME[n].unit}]' for n in shown)]
    text = (
        f'Equal penalty: over {intrusions.stages} stages that the MPCC plans inside the safety '
        f'distance (down to {intrusions.deepest:.2f} of it) its Gaussian pushes with '
        f'{intrusions.force_share:.2f} of what the step does at equal P_k; "/4" is the step at '
        f'{variants.EQUAL_PENALTY:g} P_k, "x4" the Gaussian at {1 / variants.EQUAL_PENALTY:g} P_k.'
        ' Medians; a dash: does not brake in most runs.\n\n'
    )
    for frame, seen in frames.items():
        text += ''.join(_seen(frame, one) for one in seen)
    text += '\n'
    cells = dict.fromkeys((row['where'], row['clearance_m'], row['speed_kph']) for row in rows)
    for where, clearance, kph in cells:
        asked = '' if clearance is None else f', D_sft,O {clearance:g} m'
        lines = [
            [
                row['row'],
                str(row['runs']),
                f'{row["cleared"]:.0%} [{row["cleared_low"]:.2f}, {row["cleared_high"]:.2f}]',
                *(BY_NAME[name].told(row[name]) for name in shown),
            ]
            for row in rows
            if (row['where'], row['clearance_m'], row['speed_kph']) == (where, clearance, kph)
        ]
        text += f'## {where}, {kph:g} km/h{asked}\n\n{tables.markdown(header, lines)}\n'
    return text


def _seen(frame, one):
    active = '–' if one.active_from_m is None else f'{one.active_from_m:.1f} m'
    return (
        f'- distances {frame}, obstacle {one.obstacle}: on the way there path coordinates '
        f'overestimate by up to {one.most_over_m:.2f} m and underestimate by up to '
        f'{one.most_under_m:.2f} m; a plan enters its safety distance from station {active}.\n'
    )


def _switches_told(switches):
    header = ['where', 'factor', 'from', 'to', 'verdict', 'turned on', 'turned off', 'pairs']
    lines = [
        [
            *(row[name] for name in ('where', 'factor', 'before', 'after', 'verdict')),
            *(str(len(row[name])) for name in ('turned_on', 'turned_off')),
            str(row['pairs']),
        ]
        for row in switches
    ]
    return f'The drives are named in the JSON.\n\n{tables.markdown(header, lines)}\n'
