"""`experiments study decide`, `setting`, `exists`, ...: what is done with many settings."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import yaml
from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.settings import arms, drive, outcomes, preregistration
from experiments.settings import setting as settings
from experiments.settings.setting import Rejected, Setting
from experiments.settings_analysis import (
    accepted_rows,
    baseline_tuning,
    decision_report,
    existence,
    existence_report,
    picture_search,
    pictures_of_study,
    published,
    study_tables,
    tuned_table,
)
from experiments.settings_analysis import picture as pictures
from experiments.study import tables

QUICK_TRIALS = {'exists': 12, 'baseline': 4}
QUICK_HOLD_OUT = ('best', 'perturbations', 'neighbours')  # two of each
TUNED_CELLS, TUNED_ROWS = 'frenet_tuned.yaml', 'frenet_tuned.csv'
JUDGED_SEED, JUDGED = 1000, 8  # of the settings on which the tuned baseline is judged, per cell


class Request(NamedTuple):
    """The arguments of the command."""

    part: str
    folders: Sequence[Path]  # of studies
    out: Path
    number: int | None  # of a setting
    seed: int
    trials: int | None
    jobs: int
    quick: bool
    pages: Sequence[Path] = ()  # that get the results


def run(request: Request, console: Console) -> int:
    """Do one part, print the files that it wrote; return the exit code. Raises BagError."""
    if request.part == 'recompute':
        return _recompute(request, console)
    parts = {
        'decide': _decide,
        'setting': _setting,
        'exists': _exists,
        'baseline': _baseline,
        'result': _result,
    }
    for path in parts[request.part](request, console):
        print_text(console, str(path))
    return 0


def _folder(request):
    """Return the folder of the study, None without. Raises BagError for several."""
    if len(request.folders) > 1:
        raise BagError(f'{request.part}: takes one DIR, has {len(request.folders)}')
    return request.folders[0] if request.folders else None


def _decide(request, console):
    if not request.folders:
        raise BagError('decide: needs the DIR that `experiments study settings` wrote')
    return decision_report.run(request.folders, request.out)


def _result(request, console) -> Sequence[Path]:
    """Decide runs anew, if any are given; write what the decided ones say into pages."""
    paths = published.decide(request.folders, request.out)
    return [*paths, *published.write(request.out, request.pages)]


def _recompute(request, console) -> int:
    """Decide the kept rows anew and print every claim; 1 where one is published otherwise."""
    folder = _folder(request) or request.out
    claims = list(accepted_rows.recompute(folder))
    rows = [
        [
            *(claim.run, claim.baseline, claim.claim, f'{claim.holds:,} of {claim.settings:,}'),
            '–' if claim.share is None else f'{claim.share[0]:.3f} to {claim.share[1]:.3f}',
            f'differs: {", ".join(claim.differs)}' if claim.differs else 'equal',
        ]
        for claim in claims
    ]
    header = ['run', 'baseline', 'claim', 'holds', '95 %', 'published']
    table = tables.markdown_table(header, rows)
    console.print(table, markup=False, highlight=False, soft_wrap=True)
    if missing := accepted_rows.without(folder):
        print_text(console, f'no rows are kept of: {", ".join(missing)}')
    return 1 if any(claim.differs for claim in claims) else 0


def _setting(request, console) -> Sequence[Path]:
    """Drive one setting by all arms; print what they did and what that says."""
    if request.number is None or request.number < 0:
        raise BagError('setting: needs --number N, that of a setting: 0 or more')
    plan = preregistration.load()
    (values,) = settings.draw(plan, request.seed, request.number, 1)
    built = settings.build(plan, request.number, values)
    if isinstance(built, Rejected):
        raise BagError(f'point {request.number} of seed {request.seed} is none: {built.reason}')
    names = (arms.NO_CA, arms.MPCC, arms.MATCHED, arms.LINEAGE)
    chosen = range(1 if request.quick else len(plan.perturbations))
    rows = []
    with CountProgress(console) as progress, Pool(request.jobs) as pool:
        tasks = [(drive.plan_drive(plan, built, name, k),) for k in chosen for name in names]

        def show():
            progress.show('drives', len(rows) + 1, len(tasks))

        for (task,), text in zip(tasks, pool.run(drive.run, tasks, show)):
            rows.append(
                {
                    'setting': built.number,
                    'arm': task.name,
                    'perturbation': task.perturbation,
                    **dict(settings.describe(built)),
                    'error': '',
                    **json.loads(text),
                }
            )
    judged = list(outcomes.build(plan, rows))
    console.print(yaml.safe_dump(dict(values), sort_keys=False), highlight=False, markup=False)
    console.print(_drive_table(rows), markup=False, highlight=False)
    console.print(_outcome_table(judged), markup=False, highlight=False)
    return _write_setting(plan, built, rows, judged, request.out)


SHOWN = (
    *('v2o_1_m', 'outline_1_m', 'v2o_2_m', 'min_v2e_m', 'peak_sideslip_deg', 'min_speed_mps'),
    *('brake_onset_planned_at_m', 'limit_share', 'completed'),
)


def _drive_table(rows):
    lines = [
        [row['arm'], str(row['perturbation']), *(_cell(row.get(name)) for name in SHOWN)]
        for row in rows
    ]
    return tables.markdown_table(['arm', '', *SHOWN], lines)


def _outcome_table(judged: Sequence[Mapping[str, Any]]):
    names = [name for name in judged[-1] if name not in ('setting', 'S')]
    return tables.markdown_table(
        names, [[_cell(row.get(name)) for name in names] for row in judged]
    )


def _cell(value):
    if isinstance(value, float):
        return f'{value:.2f}'
    return '–' if value is None else str(value)


def _write_setting(plan, built: Setting, rows, judged, out) -> list[Path]:
    """Write scenario, parameters and tables of a setting, for the other commands."""
    folder = out / f'setting_{built.number}'
    folder.mkdir(parents=True, exist_ok=True)
    scenario = folder / 'setting.yaml'
    scenario.write_text(built.text)
    paths = [scenario]
    for name in (arms.MPCC, arms.NO_CA, arms.MATCHED, arms.LINEAGE):
        arm = arms.build(plan, built, name)
        # not the name of the file that it is based on
        path = folder / f'setting_{name}.yaml'
        path.write_text(_controller_text(arm))
        paths.append(path)
    for name, content in (('drives', rows), ('outcomes', judged)):
        path = folder / f'{name}.csv'
        pd.DataFrame(content).to_csv(path, index=False, lineterminator='\n')
        paths.append(path)
    return paths


def _controller_text(arm):
    """Return the text of a controller file: nested parameters over the arm's base."""
    values: dict[str, Any] = {'base': f'{arm.controller}.yaml'}
    for name, value in arm.settings.items():
        group, dot, key = name.partition('.')
        if dot:
            values.setdefault(group, {})[key] = value
        else:
            values[group] = value
    return yaml.safe_dump({'/**': {'ros__parameters': values}}, sort_keys=False)


def _exists(request, console) -> Sequence[Path]:
    """Search for the paper's picture, judge what was found, write it."""
    plan, picture = preregistration.load(), pictures.load()
    trials = request.trials or (QUICK_TRIALS['exists'] if request.quick else picture.search.trials)
    if request.quick:
        kept = picture.hold_out
        few = {name: min(2, getattr(kept, name)) for name in QUICK_HOLD_OUT}
        picture = pictures_of_study.with_hold_out(picture, **few)
    starts = pictures_of_study.admissible_points(plan, picture, trials)
    if folder := _folder(request):
        study = study_tables.load(folder)
        starts = [*pictures_of_study.nearest(study, picture), *starts]
    with CountProgress(console) as progress, Pool(request.jobs) as pool:
        candidates = []

        def on_candidate(candidate):
            candidates.append(candidate)
            best = min(each.distance for each in candidates)
            note = f'distance {best:.2f}'
            progress.show('settings', len(candidates), trials, note)
            if len(candidates) % picture.search.batch == 0:
                progress.print_line(f'{len(candidates)} of {trials} settings, {note}')

        picture_search.search(plan, picture, trials, request.out, pool, on_candidate, starts)
        judged = existence.hold_out(plan, picture, candidates, pool)
    console.print(existence.demo_verdict(judged, picture), style='bold')
    return existence_report.write(plan, picture, candidates, judged, request.out)


def _baseline(request, console) -> Sequence[Path]:
    """Tune the baseline for every range of S and write the parameters of each setting."""
    plan = preregistration.load()
    size = baseline_tuning.FULL
    if request.quick:
        size = baseline_tuning.Size((101,), 2, QUICK_TRIALS['baseline'], 2)
    if request.trials:
        size = size._replace(trials=request.trials)
    judged_count = 2 if request.quick else JUDGED
    total = len(baseline_tuning.cells_of(plan)) * (
        len(size.seeds) * size.geometries * (size.trials + 1) + 2 * judged_count
    )
    done = 0
    with CountProgress(console) as progress, Pool(request.jobs) as pool:

        def show():
            nonlocal done
            done += 1
            progress.show('drives', done, total)

        table, rows = baseline_tuning.tune(plan, pool, show, size)
        judged = baseline_tuning.judge(plan, table, JUDGED_SEED, judged_count, pool, show)
    request.out.mkdir(parents=True, exist_ok=True)
    paths = [request.out / name for name in (TUNED_CELLS, 'tuning.csv', 'tuning_judged.csv')]
    paths[0].write_text(tuned_table.dump(table))
    pd.DataFrame(rows).to_csv(paths[1], index=False, lineterminator='\n')
    pd.DataFrame(judged).to_csv(paths[2], index=False, lineterminator='\n')
    if folder := _folder(request):
        demands = study_tables.load(folder).drives.drop_duplicates('setting')
        chosen = tuned_table.by_setting(table, dict(zip(demands['setting'], demands['S'])))
        paths.append(request.out / TUNED_ROWS)
        chosen.to_csv(paths[-1], lineterminator='\n')
    frame = pd.DataFrame(judged)
    better = (frame['cost_tuned'] < frame['cost_matched']).mean()
    matched, tuned = (frame[name].median() for name in ('cost_matched', 'cost_tuned'))
    console.print(
        f'on {len(frame)} settings that were not tuned on: median cost {matched:.2f} matched, '
        f'{tuned:.2f} tuned; lower in {better:.0%}',
        highlight=False,
    )
    return paths
