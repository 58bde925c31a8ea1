"""Times and assessments as one row of figures per solver."""

from collections import Counter

import assessment
import numpy as np
from assessment import GOOD, OTHER_MINIMUM, Assessment
from interleaved_runs import COLD, POP_UP, WARM, Timings
from solver_variants import BASELINE, SECOND

MS = 1e3
SLOWEST = 8  # problems to be shown
SOLVED = (GOOD, OTHER_MINIMUM)


def summarize(
    timings: Timings, assessments: dict[str, list[Assessment]], limit_s: float
) -> dict[str, dict]:
    """Return the figures of every solver by its label.

    `limit_s` is when the answer to an obstacle that appears must be there.
    """
    rows = {label: _row(timings, assessments[label], label, limit_s) for label in timings.tasks}
    for label, row in rows.items():
        row['ratio_to_fatrop'] = ratios(timings, assessments, label) if BASELINE in rows else None
    return rows


def ratios(
    timings: Timings, assessments: dict[str, list[Assessment]], label: str
) -> dict[str, float] | None:
    """Return the times relative to the baseline, over the warm starts that the baseline solved.

    Its slow failures would favour the other solvers. None where it solved nothing.
    """
    tasks, answers = timings.tasks[BASELINE], assessments[BASELINE]
    solved = [t.kind == WARM and v.kind in SOLVED for t, v in zip(tasks, answers)]
    if not any(solved):
        return None
    own, baseline = (times(timings.seconds[name][:, solved]) for name in (label, BASELINE))
    return {name.removesuffix('_ms'): own[name] / baseline[name] for name in own}


def alone(timings: Timings, assessments: dict[str, list[Assessment]]) -> dict[str, dict]:
    """Return the times of every solver by the kind of start, and its ratio to the baseline."""
    rows = {}
    for label, tasks in timings.tasks.items():
        kinds = np.array([task.kind for task in tasks])
        rows[label] = {
            kind: times(timings.seconds[label][:, kinds == kind]) for kind in (WARM, COLD, POP_UP)
        }
        if BASELINE in timings.tasks:
            rows[label]['ratio_to_fatrop'] = ratios(timings, assessments, label)
    return rows


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


def _row(timings, assessments, label, limit_s):
    kinds = np.array([task.kind for task in timings.tasks[label]])
    seconds = timings.seconds[label]
    row = times(seconds[:, kinds == WARM])
    warm, cold, pop_up = (_of_kind(assessments, kinds, kind) for kind in (WARM, COLD, POP_UP))
    iterations = np.array([answer.iterations for answer in timings.answers[label]])
    row |= {
        'median_iterations': float(np.median(iterations[kinds == WARM])),
        'max_iterations': int(iterations[kinds == WARM].max()),
        'success_rate': assessment.success_rate(warm),
        'cold_success_rate': assessment.success_rate(cold),
        'max_cost_gap': assessment.max_gap(warm),
        'max_residual': finite(max(v.residual for v in warm)),
        'raw_max_ms': float(seconds[:, kinds == WARM].max() * MS),
        'verdicts': dict(Counter(v.kind for v in warm)),
        'endings': dict(Counter(answer.message for answer in timings.answers[label])),
    }
    row |= _in_time(timings, assessments, label, limit_s, kinds == POP_UP)
    row['slowest'] = _slowest(timings, label, kinds == WARM)
    aided = np.array([answer.message.startswith(SECOND) for answer in timings.answers[label]])
    row['second_share'] = float(aided[kinds == WARM].mean())
    for name, of_kind, mask in (('cold', cold, kinds == COLD), ('pop_up', pop_up, kinds == POP_UP)):
        row |= {f'{name}_{key}': value for key, value in times(seconds[:, mask]).items()}
        row[f'{name}_second_share'] = float(aided[mask].mean())
        row[f'{name}_success_rate'] = assessment.success_rate(of_kind)
        row[f'{name}_verdicts'] = dict(Counter(v.kind for v in of_kind))
        row[f'{name}_other_minima'] = sum(v.kind == OTHER_MINIMUM for v in of_kind)
    row['other_minima'] = sum(v.kind == OTHER_MINIMUM for v in warm)
    return row


def _in_time(timings, assessments, label, limit_s, mask):
    """Count pop-up obstacles answered well within the limit; other minima count if in time."""
    late = np.median(timings.seconds[label][:, mask], axis=0) > limit_s
    well = [one.kind in SOLVED for one, popped in zip(assessments, mask) if popped]
    return {
        'pop_up_late': int(late.sum()),
        'pop_up_in_time_rate': float(np.mean(well & ~late)),
    }


def _slowest(timings, label, mask):
    """Return the slowest warm starts: their iterations, and their times in every pass.

    Many iterations belong to the problem; times that differ from pass to pass to the machine.
    """
    ms = timings.seconds[label] * MS
    order = sorted(np.flatnonzero(mask), key=lambda j: -np.median(ms[:, j]))
    return [
        {
            'problem': int(j),
            'iterations': int(timings.answers[label][j].iterations),
            'message': timings.answers[label][j].message,
            'ms': [float(one) for one in ms[:, j]],
        }
        for j in order[:SLOWEST]
    ]


def _of_kind(assessments, kinds, kind):
    return [one for one, its in zip(assessments, kinds) if its == kind]
