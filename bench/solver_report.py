"""The figures of a run as tables, as bench/solver.md and as bench/solver.json."""

import json

import numpy as np
from assessment import MAX_GAP, MAX_RESIDUAL
from interleaved_runs import COLD, POP_UP, WARM
from problems import Problems
from solver_variants import BASELINE, NATIVE, NATIVE_FLAGS, ONE_STEP, OURS
from tables import TextTable, markdown, number, share


def activity(problems: Problems, active: dict[str, np.ndarray], demanding: np.ndarray) -> TextTable:
    """Return how many problems of each loop have which priorities and limits active."""
    rows = []
    for i, name in enumerate([*problems.names, 'all']):
        chosen = problems.loop == i if i < len(problems.names) else np.full(len(demanding), True)
        counts = [str(int(mask[chosen].sum())) for mask in active.values()]
        part = demanding[chosen]
        rows.append((str(name), str(chosen.sum()), *counts, f'{part.sum()} ({share(part.mean())})'))
    columns = ('loop', 'problems', *active, 'obstacle, edge or friction')
    return TextTable('Problems by what is active in their plans', columns, rows)


def timing(rows: dict[str, dict]) -> TextTable:
    """Return the main table."""
    columns = ('solver', 'median', 'p99', 'max', 'iterations', 'good', 'other minima')
    columns += ('max gap', 'max residual', f'/ {BASELINE}: median', 'p99', 'max')
    lines = []
    for label, row in rows.items():
        ratio = row['ratio_to_fatrop']
        lines.append(
            (
                label,
                *(number(row[key]) for key in ('median_ms', 'p99_ms', 'max_ms')),
                f'{row["median_iterations"]:.0f} / {row["max_iterations"]}',
                share(row['success_rate']),
                str(row['other_minima']),
                f'{row["max_cost_gap"]:.0e}',
                'not finite' if row['max_residual'] is None else f'{row["max_residual"]:.0e}',
                *(number(ratio[key]) if ratio else '-' for key in ('median', 'p99', 'max')),
            )
        )
    return TextTable('Warm starts (ms)', columns, lines)


def starts(rows: dict[str, dict]) -> TextTable:
    """Return how cold starts and obstacles that appear ahead go."""
    columns, lines = ['solver'], []
    for kind in ('cold', 'pop-up'):
        columns += [f'{kind}: median', 'p99', 'max', 'good', 'other minima', 'second']
    columns += ['late']
    for label, row in rows.items():
        cells = [label]
        for kind in ('cold', 'pop_up'):
            cells += [number(row[f'{kind}_{key}']) for key in ('median_ms', 'p99_ms', 'max_ms')]
            cells += [share(row[f'{kind}_success_rate']), str(row[f'{kind}_other_minima'])]
            cells += [f'{100 * row[f"{kind}_second_share"]:.1f} %']
        cells += [str(row['pop_up_late'])]
        lines.append(tuple(cells))
    return TextTable('Cold starts, and obstacles that appear 15 to 40 m ahead (ms)', columns, lines)


def alone(rows: dict[str, dict]) -> TextTable:
    """Return the times of solvers that run alone, one after the other."""
    kinds, keys = (WARM, COLD, POP_UP), ('median_ms', 'p99_ms', 'max_ms')
    columns = ['solver', *(f'{kind}: {key[:-3]}' for kind in kinds for key in keys)]
    lines = []
    for label, row in rows.items():
        ratio = row.get('ratio_to_fatrop')
        cells = [number(row[kind][key]) for kind in kinds for key in keys]
        lines.append((label, *cells, number(ratio['median']) if ratio else '-'))
    columns.append(f'warm median / {BASELINE}')
    return TextTable('Each solver alone (ms)', columns, lines)


def slowest(rows: dict[str, dict]) -> TextTable:
    """Return the slowest warm starts of our solver: is it the problem or the machine?"""
    columns = ('problem', 'iterations', 'median ms', 'least of the passes', 'most', 'ending')
    lines = [
        (
            str(one['problem']),
            str(one['iterations']),
            *(number(float(f(one['ms']))) for f in (np.median, np.min, np.max)),
            one['message'],
        )
        for one in rows.get(OURS, {'slowest': []})['slowest']
    ]
    return TextTable(f'The slowest warm starts of {OURS}', columns, lines)


def as_json(machine: dict, count: int, rows: dict[str, dict], others: dict) -> str:
    """Return bench/solver.json: `count` problems, a row per solver, and other figures."""
    everything = {'machine': machine, 'problems': count, 'solvers': rows} | others
    return json.dumps(everything, indent=2, allow_nan=False) + '\n'


def as_markdown(machine: dict, settings: str, text_tables: list[TextTable], labels) -> str:
    """Return bench/solver.md."""
    facts = '\n'.join(f'- {name}: {value}' for name, value in machine.items())
    parts = [f'# Solvers\n\nMade by `make bench`: {settings}.\n\n{facts}\n', _method(labels)]
    return '\n'.join(parts + [markdown(text_table) for text_table in text_tables])


def _method(labels):
    missing = [label for label in (OURS, ONE_STEP) if label not in labels]
    absent = f'Not in this version: {", ".join(missing)}.\n\n' if missing else ''
    return (
        f'{absent}'
        'Every solver starts from its own plans (and multipliers, where it takes them) of the tick '
        'before, moved on as the controller does it. The solvers take turns on one core, problem '
        'by problem; the time of a problem is the median over the passes, measured around the '
        'call; median, p99 and max are over the problems. Absolute times depend on what else the '
        f'machine does, ratios do not; they leave out the problems that {BASELINE} does not '
        'solve. The first tick of a loop has no plan to start from and is not among the warm '
        'starts. "Alone": the same problems, one solver after the other, so that each has the '
        'caches of the processor for itself, as in a controller. `_c`: CasADi functions compiled '
        'by gcc -O2; `_vm`: '
        f'interpreted; `{NATIVE}`: with {" ".join(NATIVE_FLAGS)}, as our own solver may use it. '
        f'`{ONE_STEP}`: from a plan it ends after the first step that leaves little to gain '
        '(docs/solver.md); without a plan it converges. Ours ask fatrop in turn when their answer '
        'must not be driven; its time counts as theirs, the share of such solves is in the column '
        '"second". "Late": obstacles answered after more than the 40 ms that both have.\n\n'
        f'Good: residual of every constraint at most {MAX_RESIDUAL:g} (m, rad, kN, ...) and '
        f'cost within {MAX_GAP:g} (relative) of what IPOPT finds with a tolerance of 1e-8 from '
        'the same start. An answer within that of a minimum that IPOPT finds from the answer, '
        'while from the start it finds another one, is at another minimum and counts neither way. '
        'Costs and residuals are evaluated from the stage functions, not taken from the solvers.\n'
    )
