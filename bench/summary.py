"""Times and verdicts of a race as one row of figures per solver."""

from collections import Counter

import numpy as np
import verdict
from race import COLD, POP_UP, WARM, Race
from variants import BASELINE, SECOND
from verdict import GOOD, OTHER_MINIMUM, Verdict

MS = 1e3
SLOWEST = 8  # problems to be shown
SOLVED = (GOOD, OTHER_MINIMUM)


def of(race: Race, verdicts: dict[str, list[Verdict]], limit_s: float) -> dict[str, dict]:
    """Return the figures of every solver by its label.

    `limit_s` is when the answer to an obstacle that appears must be there.
    """
    rows = {label: _row(race, verdicts[label], label, limit_s) for label in race.tasks}
    for label, row in rows.items():
        row['ratio_to_fatrop'] = ratios(race, verdicts, label) if BASELINE in rows else None
    return rows


def ratios(race: Race, verdicts: dict[str, list[Verdict]], label: str) -> dict[str, float] | None:
    """Return each time over that of the baseline, over the warm starts that the baseline solved.

    Its failures take it longest, and would flatter everybody else. None where it solved nothing.
    """
    tasks, answers = race.tasks[BASELINE], verdicts[BASELINE]
    solved = [t.kind == WARM and v.kind in SOLVED for t, v in zip(tasks, answers)]
    if not any(solved):
        return None
    own, baseline = (times(race.seconds[name][:, solved]) for name in (label, BASELINE))
    return {name.removesuffix('_ms'): own[name] / baseline[name] for name in own}


def times(seconds: np.ndarray) -> dict[str, float]:
    """Return median, p99 and maximum [ms] of (passes, tasks): each task counts with its median."""
    ms = np.median(seconds, axis=0) * MS
    return {
        'median_ms': float(np.median(ms)),
        'p99_ms': float(np.quantile(ms, 0.99)),
        'max_ms': float(ms.max()),
    }


def finite(value: float) -> float | None:
    """Return a number that JSON has; None stands for the others."""
    return value if np.isfinite(value) else None


def _row(race, verdicts, label, limit_s):
    kinds = np.array([task.kind for task in race.tasks[label]])
    seconds = race.seconds[label]
    row = times(seconds[:, kinds == WARM])
    warm, cold, pop_up = (_of_kind(verdicts, kinds, kind) for kind in (WARM, COLD, POP_UP))
    iterations = np.array([answer.iterations for answer in race.answers[label]])
    row |= {
        'median_iterations': float(np.median(iterations[kinds == WARM])),
        'max_iterations': int(iterations[kinds == WARM].max()),
        'success_rate': verdict.success_rate(warm),
        'cold_success_rate': verdict.success_rate(cold),
        'max_cost_gap': verdict.max_gap(warm),
        'max_residual': finite(max(v.residual for v in warm)),
        'raw_max_ms': float(seconds[:, kinds == WARM].max() * MS),
        'verdicts': dict(Counter(v.kind for v in warm)),
        'endings': dict(Counter(answer.message for answer in race.answers[label])),
    }
    row |= _in_time(race, verdicts, label, limit_s, kinds == POP_UP)
    row['slowest'] = _slowest(race, label, kinds == WARM)
    aided = np.array([answer.message.startswith(SECOND) for answer in race.answers[label]])
    row['second_share'] = float(aided[kinds == WARM].mean())
    for name, of_kind, mask in (('cold', cold, kinds == COLD), ('pop_up', pop_up, kinds == POP_UP)):
        row |= {f'{name}_{key}': value for key, value in times(seconds[:, mask]).items()}
        row[f'{name}_second_share'] = float(aided[mask].mean())
        row[f'{name}_success_rate'] = verdict.success_rate(of_kind)
        row[f'{name}_verdicts'] = dict(Counter(v.kind for v in of_kind))
        row[f'{name}_other_minima'] = sum(v.kind == OTHER_MINIMUM for v in of_kind)
    row['other_minima'] = sum(v.kind == OTHER_MINIMUM for v in warm)
    return row


def _in_time(race, verdicts, label, limit_s, mask):
    """Count pop-up obstacles answered well within the limit; other minima count if in time."""
    late = np.median(race.seconds[label][:, mask], axis=0) > limit_s
    well = [verdict.kind in SOLVED for verdict, popped in zip(verdicts, mask) if popped]
    return {
        'pop_up_late': int(late.sum()),
        'pop_up_in_time_rate': float(np.mean(well & ~late)),
    }


def _slowest(race, label, mask):
    """Return the slowest warm starts: their iterations, and their times in every pass.

    Many iterations belong to the problem; times that differ from pass to pass to the machine.
    """
    ms = race.seconds[label] * MS
    order = sorted(np.flatnonzero(mask), key=lambda j: -np.median(ms[:, j]))
    return [
        {
            'problem': int(j),
            'iterations': int(race.answers[label][j].iterations),
            'message': race.answers[label][j].message,
            'ms': [float(one) for one in ms[:, j]],
        }
        for j in order[:SLOWEST]
    ]


def _of_kind(verdicts, kinds, kind):
    return [verdict for verdict, its in zip(verdicts, kinds) if its == kind]
