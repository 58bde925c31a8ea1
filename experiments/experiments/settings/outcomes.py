"""Preconditions and claims of every setting, from the table of drives."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from experiments.settings import preconditions, primaries
from experiments.settings.arms import BASELINES, MPCC, NO_CA
from experiments.settings.preregistration import Preregistration

Rows = Mapping[tuple[str, int], Mapping[str, Any]]  # of one setting, by arm and perturbation


def group(rows: Iterable[Mapping[str, Any]]) -> dict[int, dict[tuple[str, int], Mapping]]:
    """Return the rows of the table by setting, arm and perturbation."""
    grouped: dict[int, dict[tuple[str, int], Mapping]] = {}
    for row in rows:
        by_arm = grouped.setdefault(int(row['setting']), {})
        by_arm[row['arm'], int(row['perturbation'])] = row
    return grouped


def build(plan: Preregistration, rows: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a row for each setting, version of the baseline and perturbation that was driven.

    Columns: setting, S, baseline, perturbation; P0 to P4 of the unperturbed drives; for each claim
    `<claim>.difference` and `<claim>.holds`. Settings without contact at obstacle 1 were driven by
    the car without collision avoidance only: they have one row, without a baseline and claims.
    """
    for number, drives in group(rows).items():
        no_ca = drives.get((NO_CA, 0))
        if no_ca is None:
            continue
        if (MPCC, 0) not in drives:
            alone = preconditions.evaluate(plan.preconditions, no_ca, {}, {})
            yield {'setting': number, 'S': no_ca['S'], 'baseline': '', **alone._asdict()}
            continue
        for baseline in BASELINES:
            yield from _of_baseline(plan, number, drives, baseline)


def levels(plan: Preregistration, drives: Rows, baseline: str) -> preconditions.Levels | None:
    """Return the conditions of a setting, None without the unperturbed drives."""
    arms = (NO_CA, MPCC, baseline)
    if any((arm, 0) not in drives for arm in arms):
        return None
    return preconditions.evaluate(plan.preconditions, *(drives[arm, 0] for arm in arms))


def _of_baseline(plan, number, drives, baseline):
    met = levels(plan, drives, baseline)
    if met is None:
        return
    for perturbation in range(len(plan.perturbations)):
        pair = [drives.get((arm, perturbation)) for arm in (MPCC, baseline)]
        if None in pair or any(row.get('error') for row in pair):
            continue
        row = {
            'setting': number,
            'S': pair[0]['S'],
            'baseline': baseline,
            'perturbation': perturbation,
            **met._asdict(),
        }
        for claim, outcome in primaries.evaluate(plan.primaries, *pair).items():
            row |= {f'{claim}.{name}': value for name, value in outcome._asdict().items()}
        yield row
