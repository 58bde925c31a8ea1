"""`experiments study result`: the decided claims in a few sentences, for a page."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bags.errors import BagError
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.preregistration import RUNS

BLOCK = 'result'  # of the page
FILE = 'claims.json'
# what holds, and where; in the order in which it is printed
SENTENCES = {
    'unsafe_area': 'the baseline enters an unsafe area and the MPCC does not',
    'sideslip': 'the baseline slides with at least 6 deg and the MPCC with at most 4 deg',
    'brake_onset': 'the MPCC brakes at least 10 m earlier',
    'min_speed': 'the MPCC keeps a least speed higher by at least 0.5 m/s',
    'conjunction': 'all four hold at once',
}


def write(folder: Path, page: Path | None) -> str:
    """Return the text about the decided runs in a folder; put it into the block of a page.

    The confirmatory run is needed, its repetition is not. Raises BagError.
    """
    from experiments import page_block

    confirmatory = _read(folder / RUNS[0] / FILE)
    again = folder / RUNS[1] / FILE
    text = build(confirmatory, _read(again) if again.exists() else None)
    if page:
        page_block.replace(page, BLOCK, f'\n{text}')
    return text


def _read(file):
    try:
        return json.loads(file.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        text = f'{file}: is no result of `experiments study decide`: {error}'
        raise BagError(text) from None


def build(confirmatory: Mapping[str, Any], repetition: Mapping[str, Any] | None) -> str:
    """Return the sentences from the contents of two claims.json."""
    claims = {claim['key']: claim for claim in confirmatory['claims'] if claim['confirmatory']}
    if not claims:
        raise BagError('the run is not as preregistered: it confirms nothing')
    origin = confirmatory['provenance']
    (baseline,) = {claim['baseline'] for claim in claims.values()}
    accepted = next(
        row[ACCEPTED]
        for row in confirmatory['counts']
        if row['baseline'] == baseline and row['least'] == 'P1'
    )
    lines = [
        'The paper prints neither geometry, nor speed, nor weights: '
        f'{origin["settings"]:,} settings were drawn at random from all that is not printed, and '
        f'in {accepted:,} of them its own preconditions hold (without collision avoidance the car '
        'hits obstacle 1, MPCC and baseline avoid both, all three reach the lateral limit of the '
        'car). Among these, where the claim has a meaning:',
        '',
        '| claim | holds | 95 % interval | verdict |',
        '|---|---|---|---|',
    ]
    for key, text in SENTENCES.items():
        if key in claims:
            lines.append(_row(text, claims[key]))
    lines += ['', _repeated(claims, repetition)] if repetition else []
    return '\n'.join(lines) + '\n'


def _row(text, claim):
    if not claim['settings']:
        return f'| {text} | – | – | open: no such setting |'
    low, high = claim['interval']
    where = ', both cars braking' if claim['level'].endswith('P4') else ''
    return (
        f'| {text} | {claim["holds"]} of {claim["settings"]}{where} | {low:.0%} to {high:.0%} '
        f'| **{claim["verdict"]}** |'
    )


def _repeated(claims, repetition):
    again = {
        claim['key']: claim['verdict']
        for claim in repetition['claims']
        if claim['baseline'] == next(iter(claims.values()))['baseline']
    }
    changed = _changed(claims, again)
    settings = f'{repetition["provenance"]["settings"]:,} settings of another seed'
    if not changed:
        return f'A repetition with {settings} gives the same verdicts.'
    return f'A repetition with {settings} gives another verdict on {", ".join(changed)}.'


def _changed(claims, again) -> Sequence[str]:
    return [
        f'{key} ({again.get(key)} instead of {claim["verdict"]})'
        for key, claim in claims.items()
        if again.get(key) != claim['verdict']
    ]
