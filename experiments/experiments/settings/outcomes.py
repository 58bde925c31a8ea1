"""Preconditions and claims of every setting, from the table of drives."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from experiments.settings import preconditions, primaries
from experiments.settings.plan import Plan

# controllers of the rows: the paper's MPCC, the same without collision avoidance, and the baseline
# with the MPCC's tolerances or with tolerances, circles and brake split of its lineage's open code
MPCC, NO_CA, MATCHED, LINEAGE = 'mpcc', 'mpcc_no_ca', 'frenet_matched', 'frenet_lineage'
BASELINES = (MATCHED, LINEAGE)
NOT_DRIVEN: Mapping[str, Any] = {}
# conditions that a perturbed start may change; the car without avoidance drives the first one only
OF_A_START = ('P2', 'P3', 'P4')
Rows = Mapping[tuple[str, int], Mapping[str, Any]]  # of one setting, by arm and perturbation


def group(rows: Iterable[Mapping[str, Any]]) -> dict[int, dict[tuple[str, int], Mapping]]:
    """Return the rows of the table by setting, arm and perturbation."""
    grouped: dict[int, dict[tuple[str, int], Mapping]] = {}
    for row in rows:
        by_arm = grouped.setdefault(int(row['setting']), {})
        by_arm[row['arm'], int(row['perturbation'])] = row
    return grouped


def build(plan: Plan, rows: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a row for each setting, version of the baseline and perturbation that was driven.

    Columns: setting, S, baseline, perturbation; P0 to P4 of the unperturbed drives; `start.P2` to
    `start.P4` of the drives of this start; for each claim `<claim>.difference` and
    `<claim>.holds`, both None where nothing is known. A setting with claims that count has a row
    for each start, whether or not its drives ended. Settings that no baseline drove have one row,
    without a baseline and claims.
    """
    for number, drives in group(rows).items():
        no_ca = drives.get((NO_CA, 0))
        if no_ca is None:
            continue
        mpcc = drives.get((MPCC, 0), NOT_DRIVEN)
        if not any(levels(plan, drives, baseline) for baseline in BASELINES):
            alone = preconditions.evaluate(plan.preconditions, no_ca, mpcc, NOT_DRIVEN)
            yield {'setting': number, 'S': no_ca['S'], 'baseline': '', **alone._asdict()}
            continue
        for baseline in BASELINES:
            yield from _baseline_rows(plan, number, drives, baseline)


def levels(plan: Plan, drives: Rows, baseline: str) -> preconditions.Levels | None:
    """Return the conditions of a setting, None without the unperturbed drives."""
    arms = (NO_CA, MPCC, baseline)
    if any((arm, 0) not in drives for arm in arms):
        return None
    return preconditions.evaluate(plan.preconditions, *(drives[arm, 0] for arm in arms))


def _baseline_rows(plan, number, drives, baseline):
    met = levels(plan, drives, baseline)
    if met is None:
        return
    no_ca = drives[NO_CA, 0]
    counts = met.reaches(preconditions.ACCEPTED, plan.decision.from_level)
    for perturbation in range(len(plan.perturbations)):
        pair = [drives.get((arm, perturbation)) for arm in (MPCC, baseline)]
        if None in pair and not counts:
            continue  # nobody drives the perturbed starts of such a setting
        is_known = None not in pair and not any(row.get('error') for row in pair)
        known = pair if is_known else [NOT_DRIVEN, NOT_DRIVEN]
        start = preconditions.evaluate(plan.preconditions, no_ca, *known)._asdict()
        row = {
            'setting': number,
            'S': no_ca['S'],
            'baseline': baseline,
            'perturbation': perturbation,
            **met._asdict(),
            **{f'start.{level}': start[level] for level in OF_A_START},
        }
        verdicts = primaries.evaluate(plan.primaries, *pair) if is_known else primaries.ALL_UNKNOWN
        for claim, outcome in verdicts.items():
            row |= {f'{claim}.{name}': value for name, value in outcome._asdict().items()}
        yield row
