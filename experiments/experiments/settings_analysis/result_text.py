"""The decided claims in five sentences and a figure, from claims.json of the preregistered runs.

The verdicts are those of the confirmatory run. Where its repetition from another seed is decided,
the text says whether it changes one, and where both are pooled the counts are those of both.
"""

import json
import posixpath
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.settings import preregistration
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.preregistration import RUNS
from experiments.settings_analysis.study_tables import POOLED
from experiments.settings_analysis.verdicts import OPEN

FILE = 'claims.json'
FIGURE = 'Share of the settings in which each claim holds, with intervals'
WIDTH = 118
NAMES = {
    'unsafe_area': 'the unsafe area',
    'sideslip': 'the sideslip',
    'min_speed': 'the least speed',
    'brake_onset': 'the onset of braking',
    'conjunction': 'all of these at once',
}


class Run(NamedTuple):
    """A decided run, as far as the verdicts that count go."""

    origin: Mapping[str, Any]
    accepted: int  # settings at P3, any S
    claims: Mapping[str, Mapping[str, Any]]  # from the confirmatory version of the baseline

    def __repr__(self) -> str:
        return f'Run({self.origin["settings"]} settings, {self.accepted} accepted)'

    @property
    def verdicts(self) -> dict[str, str]:
        """The verdict by claim."""
        return {key: claim['verdict'] for key, claim in self.claims.items()}


def build(folder: Path, root: str = '.') -> str:
    """Return the text about the decided runs of a folder; links are relative to `root`.

    The confirmatory run is needed, its repetition and both pooled are not. Raises BagError for a
    run of another design than that preregistered; drives without a result are stated.
    """
    confirmatory = read(folder / RUNS[0] / FILE, RUNS[0])
    repetition, pooled = (
        read(folder / name / FILE, name) if (folder / name / FILE).exists() else None
        for name in (RUNS[1], POOLED)
    )
    if pooled and not _is_of(pooled, (confirmatory, repetition)):
        raise BagError(
            f'{folder / POOLED / FILE}: is not of the decided runs beside it; decide both at once'
        )
    shown, name = (pooled, POOLED) if pooled else (confirmatory, RUNS[0])
    sentences = [
        _settings(confirmatory, repetition, root),
        _verdicts(confirmatory, root),
        _distances(shown, bool(pooled)),
        _speeds(shown),
        f'{_provisos(confirmatory, repetition, pooled)} ({_links(name, root)}).',
    ]
    lines = [
        textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)
        for text in sentences
        if text
    ]
    figure = _link(FIGURE, f'paper/settings/{name}/shares.png', root)
    return '\n'.join([*lines, '', f'!{figure}', ''])


def read(file: Path, name: str) -> Run:
    """Return what claims.json says from the confirmatory version of the baseline.

    Raises BagError for another file, and for that of another run than the one named.
    """
    try:
        content = json.loads(file.read_text(encoding='utf-8'))
        origin = content['provenance']
        run, otherwise_driven = origin['run'], origin['otherwise_driven']
    except (OSError, ValueError, KeyError, TypeError) as error:
        text = f'{file}: is no result of `experiments study decide`: {error}'
        raise BagError(text) from None
    if run != name:
        raise BagError(f'{file}: is of the run {run}; allowed {name}')
    if otherwise_driven:
        raise BagError(f'{file}: the run is not as preregistered: {"; ".join(otherwise_driven)}')
    plan = preregistration.load()
    baseline = plan.decision.confirmatory
    accepted = next(
        row[ACCEPTED]
        for row in content['counts']
        if row['baseline'] == baseline and row['least'] == plan.decision.from_level
    )
    claims = {claim['key']: claim for claim in content['claims'] if claim['baseline'] == baseline}
    return Run(origin, accepted, claims)


def _is_of(pooled, runs):
    """Return whether pooled numbers are those of two runs, by seeds and numbers of drives."""
    if None in runs:
        return False
    seeds = [seed for run in runs for seed in run.origin['seeds']]
    drives = sum(run.origin['drives'] for run in runs)
    return pooled.origin['seeds'] == seeds and pooled.origin['drives'] == drives


def _settings(confirmatory, repetition, root):
    plan = preregistration.load()
    design = _link('design', 'docs/settings_study.md', root)
    count = f'{confirmatory.origin["settings"]:,}'
    accepted = f'{confirmatory.accepted:,}'
    again = ''
    if repetition:
        again = f', and {repetition.origin["settings"]:,} of another seed to repeat it'
        accepted += f' and {repetition.accepted:,}'
    return (
        f'The paper prints neither geometry, nor speed, nor weights: {count} settings of them were '
        f"drawn at random by a {design} fixed beforehand{again}. The paper's preconditions hold in "
        f'{accepted} of them: without collision avoidance the car hits obstacle 1, the MPCC and a '
        'baseline with the same tolerances avoid both, and all three reach '
        f"{_percent(plan.preconditions.P3.least_limit_share)} of the plant's lateral limit "
        'somewhere in the drive.'
    )


def _verdicts(run, root):
    rules = _link('rules', 'docs/settings_decision.md', root)
    verdicts = run.verdicts
    by_verdict = {
        verdict: [key for key in NAMES if verdicts.get(key) == verdict]
        for verdict in dict.fromkeys(verdicts.values())
    }
    if len(by_verdict) == 1:
        statement = f'every claim is {next(iter(by_verdict))}'
    else:
        statement = '; '.join(
            f'{verdict}: {_listed([NAMES[key] for key in keys])}'
            for verdict, keys in by_verdict.items()
        )
    plan = preregistration.load()
    text = f'**By the {rules} fixed beforehand {statement}**'
    if OPEN in by_verdict:
        text += (
            f': neither reproduced (in more than {_percent(plan.decision.holds_from)} of the '
            f'settings) nor not reproduced (in less than {_percent(plan.decision.rare_below)})'
        )
    shares = [run.claims[key]['undetermined'] for key in by_verdict.get(OPEN, [])]
    shares = [share for share in shares if share]
    if not shares:
        return f'{text}.'
    least = max(abs(start.speed_mps) for start in plan.perturbations)
    low, high = (round(100 * end) for end in (min(shares), max(shares)))
    span = f'{low} %' if low == high else f'{low} to {high} %'
    return (
        f'{text}. Each setting is driven from starts that differ by {least:g} m/s or less: in '
        f'{span} of the first {run.accepted:,}, by claim, these disagree, or one of them crashes '
        'or does not tell, and a verdict has to hold however such settings are counted.'
    )


def _distances(run, is_pooled):
    area, slides = run.claims.get('unsafe_area'), run.claims.get('sideslip')
    if not (area and slides and area['settings'] and slides['settings']):
        return ''
    limits = preregistration.load().primaries.sideslip
    where = (
        'Over both runs (pooling was not preregistered)' if is_pooled else 'By most of its starts'
    )
    text = (
        f'{where} the baseline enters a safety distance and the MPCC does not in {_count(area)} '
        f'settings, and the baseline slides by {limits.baseline_deg:g} deg or more and the MPCC by '
        f'{limits.mpcc_deg:g} deg or less in {_count(slides)}'
    )
    nearer, more = area['median_difference'], slides['median_difference']
    if nearer is None or more is None:
        return f'{text}.'
    return (
        f'{text}; in the median the MPCC keeps {abs(nearer):.2f} m '
        f'{"less" if nearer < 0.0 else "more"} distance to obstacles and edges than the baseline '
        f'and has {abs(more):.1f} deg {"more" if more < 0.0 else "less"} sideslip.'
    )


def _speeds(run):
    speed, brakes, together = (
        run.claims.get(key) for key in ('min_speed', 'brake_onset', 'conjunction')
    )
    if not (speed and brakes and together and speed['settings']):
        return ''
    primaries = preregistration.load().primaries
    both = 'in none do both brake hard before obstacle 2'
    if brakes['settings']:
        both = (
            f'it begins to brake hard {primaries.brake_onset.earlier_m:g} m earlier or more '
            f'in {brakes["holds"]:,} of the {brakes["settings"]:,} in which both do so before '
            'obstacle 2'
        )
    return (
        f'The least speed of the MPCC is higher by {primaries.min_speed.higher_mps:g} m/s or more '
        f'in {_count(speed)}, and {both}; of these all four claims hold together in '
        f'{together["holds"] or "none"}.'
    )


def _percent(share):
    return f'{100 * share:g} %'


def _count(claim):
    return f'{claim["holds"]:,} of {claim["settings"]:,}'


def _provisos(confirmatory, repetition, pooled):
    origins = [run.origin for run in (confirmatory, repetition) if run]
    failed = sum(sum(origin['failed_drives'].values()) for origin in origins)
    drives = sum(origin['drives'] for origin in origins)
    if failed:
        result = f'{failed:,} of {drives:,} drives {"has" if failed == 1 else "have"} no result'
    else:
        result = f'All of {drives:,} drives have a result'
    if not repetition:
        return f'{result}; the repetition from another seed is not decided yet'
    again = _changed(confirmatory.verdicts, repetition.verdicts)
    if not pooled:
        return f'{result}; the repetition gives {again}'
    together = _changed(confirmatory.verdicts, pooled.verdicts)
    if again == together:
        return f'{result}; the repetition gives {again}, and so do both seeds together'
    return f'{result}; the repetition gives {again}, both seeds together {together}'


def _changed(verdicts: Mapping[str, str], others: Mapping[str, str]) -> str:
    changed = [
        f'{NAMES[key]} ({others.get(key)} instead of {verdict})'
        for key, verdict in verdicts.items()
        if others.get(key) != verdict
    ]
    return f'another verdict on {_listed(changed)}' if changed else 'the same verdicts'


def _listed(texts: Sequence[str]) -> str:
    return ' and '.join([', '.join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def _links(name, root):
    places = {
        'tables': f'paper/settings/{name}/verdicts.md',
        'threats': 'docs/threats.md',
        'one point': 'docs/one_point.md',
    }
    return ', '.join(_link(text, place, root) for text, place in places.items())


def _link(text, place, root):
    return f'[{text}]({posixpath.normpath(posixpath.join(root, place))})'
