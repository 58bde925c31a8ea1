"""Who avoids and who brakes: files of a decided run, and blocks of the pages about them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bags.errors import BagError
from experiments.settings import arms
from experiments.settings.preregistration import RUNS
from experiments.settings_analysis import early_braking, outcome_figures, who_avoids
from experiments.settings_analysis.study_tables import Study
from experiments.statistical_inference import paired_interval
from experiments.study import tables

AVOIDANCE, BRAKING = 'avoidance', 'braking'
LEVELS_RUN = RUNS[2]  # the run in which all controllers drive wherever obstacle 1 is hit
SHOWN_DIMENSIONS = 8


def write(study: Study, out: Path) -> list[Path]:
    """Write both tables and their figures into the folder `out`; return the paths.

    A screened study has no table of who avoids: not all controllers drove all of its settings.
    """
    paths = write_json(out / f'{BRAKING}.json', braking := early_braking.summarise(study))
    paths += outcome_figures.write_onsets(study, out / 'braking_onsets')
    if study.is_screened or arms.MATCHED not in study.baselines:
        return paths
    paths += outcome_figures.write_dimensions(
        braking['by_dimension'],
        (arms.MPCC, arms.MATCHED),
        'share of settings at P2 in which the car brakes hard',
        out / 'braking_dimensions',
    )
    avoidance = who_avoids.summarise(study)
    paths += write_json(out / f'{AVOIDANCE}.json', avoidance)
    for across in outcome_figures.ACROSS:
        stem = out / f'avoidance_{across.rpartition("_")[0]}'
        paths += outcome_figures.write_avoidance(study, across, stem)
    return paths + outcome_figures.write_dimensions(
        avoidance['by_dimension'],
        who_avoids.COMPARED,
        'share of settings at P1 in which the car avoids',
        out / 'avoidance_dimensions',
    )


def write_json(file: Path, content: Mapping[str, Any]) -> list[Path]:
    """Write a table as JSON; return its path."""
    file.write_text(tables.dump_json(content))
    return [file]


def _read(file):
    try:
        return json.loads(file.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        text = f'{file}: is no result of `experiments study decide`: {error}'
        raise BagError(text) from None


def avoidance_text(folder: Path, root: str) -> str:
    """Return who avoids, as Markdown, from the decided run `levels`."""
    table = _read(folder / LEVELS_RUN / f'{AVOIDANCE}.json')
    arms_shown = list(table['all'])
    lines = [
        f'Of {table["drawn"]:,} settings drawn, the car without collision avoidance hits obstacle '
        f'1 in {table["settings"]:,}. Of these avoid: '
        + ', '.join(f'`{arm}` {_share(table["all"][arm])}' for arm in arms_shown)
        + '.',
        '',
        *(_paired(row) for row in table['paired']),
        '',
    ]
    low, high = table['strata_S'][:-1], table['strata_S'][1:]
    header = ['', 'latency', 'any S', *(f'S {a:g} to {b:g}' for a, b in zip(low, high))]
    rows = [
        [
            f'`{row["arm"]}`',
            f'{row["latency_ms"]} ms',
            _share(row['all']),
            *(_count(cell) for cell in row['strata']),
        ]
        for row in table['by_latency_and_S']
    ]
    lines += [tables.markdown_table(header, rows), _dimensions(table['by_dimension'], arms_shown)]
    return '\n'.join(lines)


def _paired(row: Mapping[str, Any]) -> str:
    p = row['p_value']
    chance = 'p < 0.001' if p < 0.001 else f'p = {p:.2f}'
    mpcc, baseline = row['mpcc_alone'], row['baseline_alone']
    pairs = mpcc + baseline + row['both'] + row['none']
    low, high = (100 * end for end in paired_interval(mpcc, baseline, pairs))
    return (
        f'- `mpcc` alone avoids in {mpcc:,}, `{row["baseline"]}` alone in {baseline:,}, both in '
        f'{row["both"]:,}, neither in {row["none"]:,}: {100 * (mpcc - baseline) / pairs:+.1f} '
        f"points ({low:+.1f} to {high:+.1f}; McNemar's exact test: {chance})."
    )


def braking_text(folder: Path, root: str) -> str:
    """Return who brakes and what comes with it, as Markdown, from the decided runs."""
    names = [name for name in RUNS if (folder / name / f'{BRAKING}.json').exists()]
    if LEVELS_RUN not in names:
        _read(folder / LEVELS_RUN / f'{BRAKING}.json')
    by_run = {name: _read(folder / name / f'{BRAKING}.json') for name in names}
    levels = by_run[LEVELS_RUN]
    size = f'{levels["earlier_m"]:g} m'
    shares = ', '.join(f'`{arm}` in {_share(share)}' for arm, share in levels['brakes'].items())
    header = ['run', 'against', 'level', 'settings', 'both brake', f'MPCC earlier by {size}']
    header += [f'later by {size}', 'median lead [m]', 'MPCC alone brakes', 'baseline alone', 'none']
    rows = [_pair_row(name, pair) for name, table in by_run.items() for pair in table['pairs']]
    lines = [
        f'Where MPCC and `{arms.MATCHED}` avoid, the cars brake hard before obstacle 2: {shares}.',
        '',
        tables.markdown_table(header, rows),
        'What comes with it, in the settings of the run `levels` at P2 (medians with 95 % '
        'intervals, positive where the MPCC has more speed, less sideslip, more distance):',
        '',
        _beside(levels),
        _dimensions(levels['by_dimension'], (arms.MPCC, arms.MATCHED)),
    ]
    return '\n'.join(lines)


def _pair_row(name, pair):
    who = {row['who']: row['settings'] for row in pair['who']}
    lead = '–' if pair['lead_m'] is None else _interval(pair['lead_m'])
    counts = [pair['settings'], pair['both'], pair['earlier'], pair['later']]
    alone = [who[key] for key in early_braking.WHO[3:]]
    return [name, f'`{pair["baseline"]}`', pair['level'], *map(str, counts), lead, *map(str, alone)]


def _beside(levels):
    header = ['against', 'who brakes', 'settings', 'least speed [m/s]', 'sideslip [deg]']
    header += ['kept distance [m]']
    rows = [
        [f'`{pair["baseline"]}`', row['who'], str(row['settings'])]
        + ['–' if row[claim] is None else _interval(row[claim]) for claim in early_braking.BESIDE]
        for pair in levels['pairs']
        if pair['level'] == 'P2'
        for row in pair['who']
    ]
    return tables.markdown_table(header, rows)


def _dimensions(entries, names):
    """Return a table of the dimensions over which the share varies most: lowest to highest."""
    header = ['dimension', 'groups', *(f'`{name}`' for name in names)]
    rows = [
        [
            f'`{entry["dimension"]}`',
            '; '.join(entry['groups']),
            *('; '.join(_percent(cell) for cell in entry[name]) for name in names),
        ]
        for entry in entries[:SHOWN_DIMENSIONS]
    ]
    return tables.markdown_table(header, rows)


def _share(share):
    return f'{_count(share)} ({_percent(share)})'


def _count(share):
    return f'{share["holds"]:,} of {share["of"]:,}'


def _percent(share):
    return '–' if not share['of'] else f'{share["holds"] / share["of"]:.0%}'.replace('%', ' %')


def _interval(values):
    middle, low, high = values
    return f'{middle:.2f} [{low:.2f}, {high:.2f}]'
