"""The files of `experiments study exists`: what was found, how far it is, what becomes of it."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bags.figures import style
from experiments.settings.preregistration import Preregistration
from experiments.settings_analysis import existence
from experiments.settings_analysis.existence import Judged
from experiments.settings_analysis.picture import Picture
from experiments.settings_analysis.picture_search import Candidate
from experiments.study import tables
from node_runtime import provenance

STEM, COMMAND = 'existence', 'experiments study exists'
MET, MISSED = '#0072B2', '#D55E00'


def write(
    plan: Preregistration,
    picture: Picture,
    candidates: Sequence[Candidate],
    judged: Sequence[Judged],
    out: Path,
) -> list[Path]:
    """Write tables, figure, and the nearest setting into the folder `out`; return the paths."""
    out.mkdir(parents=True, exist_ok=True)
    paths = [out / f'{STEM}.{ending}' for ending in ('md', 'csv', 'json')]
    paths[0].write_text(_text(picture, candidates, judged))
    rows = existence.as_rows(judged)
    pd.DataFrame(rows).to_csv(paths[1], index=False, lineterminator='\n')
    content = {
        'provenance': {
            'command': COMMAND,
            'preregistration_sha256': plan.digest,
            'commit': provenance.commit(),
            'machine': provenance.machine(),
        },
        'trials': len(candidates),
        'verdict': existence.demo_verdict(judged, picture),
        'judged': rows,
    }
    paths[2].write_text(tables.dump_json(content))
    if judged:
        paths += existence.write_setting(plan, judged[0].candidate, out)
        paths += _figure(picture, candidates, judged[0], out / STEM)
    return paths


def _text(picture, candidates, judged):
    driven = [candidate for candidate in candidates if not candidate.rejected]
    lines = [
        "# Does a setting show the paper's whole picture?",
        '',
        f'{len(candidates):,} trials, {len(driven):,} of them settings that could be driven. The '
        'distance is the root of the sum of squared shortfalls of '
        f'{len(picture.items)} items; 0 is the whole picture.',
        '',
        f'**{existence.demo_verdict(judged, picture)}.**',
        '',
    ]
    if not judged:
        return '\n'.join(lines)
    header = ['trial', 'distance', 'perturbed, median', 'whole picture', 'near neighbours']
    rows = [
        [
            str(result.candidate.number),
            f'{result.candidate.distance:.2f}',
            f'{result.median:.2f}',
            f'{result.whole:.0%}',
            f'{result.near_share:.0%}',
        ]
        for result in judged
    ]
    lines += [tables.markdown_table(header, rows), 'The first of them, item by item:', '']
    best = judged[0].candidate
    header = ['item', 'value', 'bounds', 'missed by']
    rows = [
        [
            name,
            '–' if best.features[name] is None else f'{best.features[name]:.2f}',
            f'{_end(bound.least)} to {_end(bound.most)}',
            f'{best.missed[name]:.2f} of {bound.scale:g}',
        ]
        for name, bound in picture.items.items()
    ]
    lines.append(tables.markdown_table(header, rows))
    return '\n'.join(lines)


def _end(value):
    return f'{value:g}' if np.isfinite(value) else '…'


def _figure(picture, candidates, best, stem):
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(11.0, 4.2), layout='constrained')
        history, items = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        distances = np.array([candidate.distance for candidate in candidates])
        driven = np.array([not candidate.rejected for candidate in candidates])
        order = np.arange(len(candidates))
        history.plot(order[driven], distances[driven], 'o', ms=3, color=MET, alpha=0.6, mew=0)
        history.step(order, np.minimum.accumulate(distances), where='post', color=style.INK, lw=1.2)
        history.set(xlabel='trial', ylabel='distance from the picture', ylim=(0.0, None))
        history.set_title('Settings that could be driven, and the best so far')
        missed = best.candidate.missed
        names = list(missed)[::-1]
        colours = [MISSED if missed[name] else MET for name in names]
        items.barh(range(len(names)), [missed[name] for name in names], color=colours, height=0.6)
        items.plot([0.0] * len(names), range(len(names)), 'o', ms=3, color=style.EDGE)
        items.set_yticks(range(len(names)), names, fontsize=7)
        items.set(xlim=(0.0, picture.cap), xlabel='missed by, in scales of the item')
        items.set_title(f'The nearest setting, distance {best.candidate.distance:.2f}')
        return style.save_figure(figure, stem)
