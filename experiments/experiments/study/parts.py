"""The parts of a study as the command names them, in full or quick."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from bags.errors import BagError
from experiments.study import ablation, claims, demand, distributions, limit, variants
from experiments.study.drives import Drives

QUICK = {'distributions': 6, 'ablation': 2, 'limit': 4, 'claims': 6}
FULL = {
    'distributions': distributions.RUNS,
    'ablation': distributions.RUNS,
    'limit': limit.RUNS,
    'claims': distributions.RUNS,
}
QUICK_SPEEDS_KPH = (distributions.POINT_KPH,)
QUICK_SWEEP_KPH = (65.0, 75.0, 85.0)
QUICK_CLEARANCES_M = (0.5,)


def run(
    part: str,
    drives: Drives,
    out: Path,
    runs: int | None = None,
    quick: bool = False,
    tuned: Sequence[Path] = (),
    roles: Mapping[str, str] = variants.ROLES,
    cause_runs: int | None = None,
    sweep_runs: int | None = None,
    rows: Sequence[str] = (),
) -> list[Path]:
    """Make one part, see `experiments study --help`, and return its files. Raises BagError."""
    if part == 'demand':  # drives nothing
        return demand.run(out)
    count = (QUICK if quick else FULL)[part] if runs is None else runs
    speeds = QUICK_SPEEDS_KPH if quick else distributions.SPEEDS_KPH
    if rows and part != 'limit':
        raise BagError(f'--row is for the limits only, not for {part}')
    playing = variants.cast(roles)
    if part == 'distributions':
        return distributions.run(drives, out, playing, count, speeds).files
    if part == 'limit':
        chosen = [*playing, *variants.others(roles, tuned)]
        if not quick:
            chosen += variants.switched(roles)
        return limit.run(drives, out, _only(rows, chosen), count).files
    if part == 'claims':
        return claims.run(drives, out, count, cause_runs, speeds, roles).files
    sweep = {'sweep_runs': sweep_runs or (1 if quick else ablation.SWEEP_RUNS)}
    if quick:
        sweep |= {'speeds_kph': QUICK_SWEEP_KPH, 'clearances_m': QUICK_CLEARANCES_M}
    return ablation.run(drives, out, count, tuned=tuned, roles=roles, **sweep).files


def _only(rows, chosen):
    if not rows:
        return chosen
    known = {one.name: one for one in chosen}
    unknown = [name for name in rows if name not in known]
    if unknown:
        raise BagError(f'no row {unknown[0]!r}; there are {", ".join(known)}')
    return [known[name] for name in dict.fromkeys(rows)]
