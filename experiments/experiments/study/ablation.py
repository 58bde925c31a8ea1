"""Ablation: single factors switched on the MPCC and the baseline, at one point and in a sweep."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import run_spec, run_statistics, tables, undisturbed_run, variants
from experiments.study.claims import STABLE_DEG
from experiments.study.metric_distributions import POINT_KPH, RUNS, run_at_speed
from experiments.study.run_statistics import BY_NAME, summarise_runs
from experiments.study.runner import Record, Runner
from experiments.study.variants import SWITCHES, Switch

SPEEDS_KPH = tuple(60.0 + 5.0 * step for step in range(8))  # 60 .. 95
CLEARANCES_M = (0.3, 0.5, 0.7)  # D_sft,O, the requested clearance
SWEEP_RUNS = 20  # per speed and clearance
STEM, SWITCHES_STEM = 'ablation', 'ablation_switches'
POINT = 'operating point'
FRAMES = {'cartesian': variants.BASE, 'path': 'path lag gaussian'}
SHOWN = ('min_v2o_m', 'peak_sideslip_deg', 'brake_onset_at_m', 'brake_onset_hard_at_m')
# properties of a run that a switch may turn
VERDICTS: dict[str, Callable[[Record], bool]] = {
    'cleared': lambda run: run.is_cleared,
    'entered unsafe area': lambda run: run.value('entered_unsafe_area'),
    f'sideslip > {STABLE_DEG:g} deg': lambda run: run.value('peak_sideslip_deg') > STABLE_DEG,
    'brakes, -500 N': lambda run: run.value('brake_onset_at_m') is not None,
    'brakes, -1500 N': lambda run: run.value('brake_onset_hard_at_m') is not None,
}


class Cell(NamedTuple):
    """One combination of the sweep."""

    clearance_m: float
    speed_kph: float

    @property
    def name(self) -> str:
        """The name of its runs in tables."""
        return f'{self.speed_kph:g} km/h, D_sft {self.clearance_m:g} m'


class Ablation(NamedTuple):
    """The result of `experiments study ablation`."""

    rows: list[dict[str, Any]]  # one per cell and row
    switches: list[dict[str, Any]]  # see find_flips; at the point, then over the sweep
    files: list[Path]

    def __repr__(self) -> str:
        return f'Ablation({len(self.rows)} rows, {len(self.switches)} switches)'


def run(
    runner: Runner,
    out: Path,
    runs: int = RUNS,
    sweep_runs: int = SWEEP_RUNS,
    speeds_kph: Sequence[float] = SPEEDS_KPH,
    clearances_m: Sequence[float] = CLEARANCES_M,
    tuned: Iterable[Path] = (),
    roles: Mapping[str, str] = variants.ROLES,
) -> Ablation:
    """Simulate `runs` draws per row at the operating point, `sweep_runs` in every cell of a sweep.

    The factors are switched on the controllers of `roles`; the other plain and tuned controllers
    are further rows, by default all in mpcc_controller/config, else the files `tuned`. Writes
    ablation.md, .csv, .json, ablation_switches likewise, and a figure per clearance. Raises
    BagError.
    """
    from experiments.study import study_figures

    chosen = [*variants.ablation_variants(roles), *variants.further_variants(roles, tuned)]
    point = run_at_speed(runner, chosen, POINT_KPH, run_spec.draw_runs(runs))
    draws = run_spec.draw_runs(sweep_runs)
    sweep = {}
    for clearance in clearances_m:
        for kph in speeds_kph:
            cell, setting = Cell(clearance, kph), {'safety.obstacle_m': clearance}
            sweep[cell] = run_at_speed(runner, chosen, kph, draws, setting, cell.name)
    by_name = {variant.name: variant for variant in chosen}
    undisturbed = {
        frame: undisturbed_run.simulate(by_name[name], POINT_KPH) for frame, name in FRAMES.items()
    }
    intrusions = undisturbed_run.planned_intrusions(undisturbed['cartesian'])
    frames = {frame: undisturbed_run.view_obstacles(run) for frame, run in undisturbed.items()}
    origin = tables.build_provenance(
        'experiments study ablation',
        variants.role_variants(roles),
        runs=runs,
        sweep_runs=sweep_runs,
        speeds_kph=list(speeds_kph),
        clearances_m=list(clearances_m),
        equal_penalty={'share_of_P_k': variants.EQUAL_PENALTY, **intrusions._asdict()},
        frames={frame: [view._asdict() for view in views] for frame, views in frames.items()},
    )
    rows = [_row(POINT, POINT_KPH, None, name, records) for name, records in point.items()]
    rows += [
        _row('sweep', cell.speed_kph, cell.clearance_m, name, records)
        for cell, by_row in sweep.items()
        for name, records in by_row.items()
    ]
    switches = _all_flips(point, sweep)
    text, title = _markdown(rows, intrusions, frames), 'Ablation: one factor at a time'
    files = tables.write_tables(out, STEM, title, rows, text, origin)
    text, title = _switches_markdown(switches), 'Which single switch turns which verdict'
    files += tables.write_tables(out, SWITCHES_STEM, title, switches, text, origin)
    files += study_figures.write_ablation(rows, out)
    return Ablation(rows, switches, files)


def _row(where, kph, clearance, name, runs):
    cleared = run_statistics.share([run.is_cleared for run in runs])
    onset, hard = (summarise_runs(runs, f'brake_onset{kind}_at_m') for kind in ('', '_hard'))
    v2o, slip = (summarise_runs(runs, quantity) for quantity in ('min_v2o_m', 'peak_sideslip_deg'))
    return {
        'where': where,
        'speed_kph': kph,
        'clearance_m': clearance,
        'row': name,
        'runs': len(runs),
        'cleared': cleared.share,
        'cleared_low': cleared.low,
        'cleared_high': cleared.high,
        'min_v2o_m': v2o.median,
        'min_v2o_least_m': v2o.least,
        'peak_sideslip_deg': slip.median,
        'peak_sideslip_most_deg': slip.most,
        'brake_onset_at_m': onset.median,
        'braking_runs': onset.runs,
        'brake_onset_hard_at_m': hard.median,
        'hard_braking_runs': hard.runs,
        'min_speed_mps': summarise_runs(runs, 'min_speed_mps').median,
        'iterations_mean': summarise_runs(runs, 'solver.iterations_mean').median,
    }


def find_flips(
    switch: Switch, cells: Mapping[str, Mapping[str, Sequence[Record]]]
) -> list[dict[str, Any]]:
    """Return for each of VERDICTS the paired runs in which the switch alone turns it.

    `cells` holds the records by the name of the cell and of the row, one per draw. A run is named
    by its cell and the number of its draw.
    """
    rows = []
    for verdict, holds in VERDICTS.items():
        turned_on, turned_off, pairs = [], [], 0
        for cell, records in cells.items():
            paired = zip(records[switch.before], records[switch.after])
            for number, (before, after) in enumerate(paired, start=1):
                pairs += 1
                if holds(before) != holds(after):
                    turned = turned_on if holds(after) else turned_off
                    turned.append(f'{cell} #{number}')
        rows.append(
            {
                'factor': switch.factor,
                'before': switch.before,
                'after': switch.after,
                'verdict': verdict,
                'pairs': pairs,
                'turned_on': turned_on,
                'turned_off': turned_off,
            }
        )
    return rows


def _all_flips(point, sweep):
    cells = {cell.name: records for cell, records in sweep.items()}
    return [
        {'where': where, **row}
        for where, records in ((POINT, {f'{POINT_KPH:g} km/h': point}), ('sweep', cells))
        for switch in SWITCHES
        for row in find_flips(switch, records)
    ]


def _markdown(rows, intrusions, frames):
    quantities = [BY_NAME[name] for name in SHOWN]
    header = ['row', 'runs', 'cleared', *(f'{q.title} [{q.unit}]' for q in quantities)]
    text = (
        f'Equal penalty: over {intrusions.stages} stages that the MPCC plans inside the safety '
        f'distance (down to {intrusions.deepest:.2f} of it) its Gaussian pushes with '
        f'{intrusions.force_share:.2f} of what the step does at equal P_k; "/4" is the step at '
        f'{variants.EQUAL_PENALTY:g} P_k, "x4" the Gaussian at {1 / variants.EQUAL_PENALTY:g} P_k.'
        ' Medians; a dash: does not brake in most runs.\n\n'
    )
    text += ''.join(_view_line(frame, view) for frame, views in frames.items() for view in views)
    text += '\n'
    cells: dict[tuple, list] = {}
    for row in rows:
        cells.setdefault((row['where'], row['clearance_m'], row['speed_kph']), []).append(row)
    for (where, clearance, kph), cell_rows in cells.items():
        requested = '' if clearance is None else f', D_sft,O {clearance:g} m'
        lines = [
            [
                row['row'],
                str(row['runs']),
                f'{row["cleared"]:.0%} [{row["cleared_low"]:.2f}, {row["cleared_high"]:.2f}]',
                *(quantity.format(row[quantity.name]) for quantity in quantities),
            ]
            for row in cell_rows
        ]
        table = tables.markdown_table(header, lines)
        text += f'## {where}, {kph:g} km/h{requested}\n\n{table}\n'
    return text


def _view_line(frame, view):
    active = '–' if view.active_from_m is None else f'{view.active_from_m:.1f} m'
    return (
        f'- distances {frame}, obstacle {view.obstacle}: on the way there path coordinates '
        f'overestimate by up to {view.most_over_m:.2f} m and underestimate by up to '
        f'{view.most_under_m:.2f} m; a plan enters its safety distance from station {active}.\n'
    )


def _switches_markdown(switches):
    header = ['where', 'factor', 'from', 'to', 'verdict', 'turned on', 'turned off', 'pairs']
    lines = [
        [
            *(row[name] for name in ('where', 'factor', 'before', 'after', 'verdict')),
            *(str(len(row[name])) for name in ('turned_on', 'turned_off')),
            str(row['pairs']),
        ]
        for row in switches
    ]
    return f'The drives are named in the JSON.\n\n{tables.markdown_table(header, lines)}\n'
