"""Tables of a study in which everything is known: drawn from stated laws."""

import numpy as np
import pandas as pd

SPAN = (0.2, 0.9)
PLAN = {
    'confirmatory': {
        'avoidance_gap': {'margin': 0.05},
        'sideslip_balance': {'margin': 0.10, 'better_by_deg': 0.5},
    },
    'balance': {'kept_m': 0.05, 'min_speed_mps': 0.3, 'brake_onset_m': 2.0},
    'stop': {'from': 12, 'widths': [0.05, 0.10], 'cap': 20},
}
# half avoided, without latency; each 25 ms divide it by 1.1
S50 = {'mpcc': 0.8, 'frenet': 0.667}
OTHERS = {
    'mpcc_heading': 0.62,
    'frenet_matched': 0.52,
    'frenet_lineage': 0.35,
    'mpcc_shipped': 0.25,
    'frenet_shipped': 0.3,
}


def judged(replicates=12, tasks=400, limits=S50, seed=1, starts=0):
    """Drives of which the share avoided is logistic in log S, steepness 4."""
    rng = np.random.default_rng(seed)
    parts = []
    for replicate in range(1, replicates + 1):
        S = rng.uniform(*SPAN, tasks)
        latency = rng.integers(0, 4, tasks)
        task = pd.DataFrame(
            {
                'replicate': replicate,
                'task': np.arange(tasks),
                'S': S,
                'stratum': np.minimum(6, (10 * (S - 0.2)).astype(int)),
                'latency_ms': 25 * np.minimum(latency, 2),
                'compensated': latency == 3,
                'friction_error': rng.uniform(-0.1, 0.1, tasks),
            }
        )
        unknown = np.where(latency == 3, 0, latency)
        slip = rng.gamma(4.0, 0.5, tasks)
        for arm, limit in limits.items():
            for start in range(starts + 1):
                part = task if start == 0 else task.head(50)
                n = len(part)
                z = 4.0 * np.log(limit / 1.1 ** unknown[:n] / S[:n])
                brakes = rng.random(n) < 0.7
                parts.append(
                    part.assign(
                        arm=arm,
                        start=start,
                        avoided=rng.random(n) < 1 / (1 + np.exp(-z)),
                        kept_m=rng.normal(0.0, 0.1, n),
                        peak_sideslip_deg=slip[:n] + rng.normal(0.0, 0.5, n),
                        min_speed_mps=rng.normal(15.0, 1.0, n),
                        brake_onset_m=np.where(brakes, rng.normal(60.0, 3.0, n), np.nan),
                    )
                )
    return pd.concat(parts, ignore_index=True)


def factorial(effects, replicates=3, tasks=30, noise=0.1, seed=2):
    """Drives of all combinations; `effects` of sideslip by factor numbers, ((0,), (0, 1), ...)."""
    rng = np.random.default_rng(seed)
    rows = []
    for replicate in range(1, replicates + 1):
        for task in range(tasks):
            level = rng.normal(3.0, 1.0)
            for k in range(16):
                bits = f'{k:04b}'
                signs = [1 if bit == '1' else -1 for bit in bits]
                slip = sum(
                    size / 2 * np.prod([signs[i] for i in at]) for at, size in effects.items()
                )
                values = level + slip + noise * rng.normal(), *rng.normal(0.0, 1.0, 3)
                rows.append((replicate, task, f'factorial:{bits}', True, *values))
    names = ('peak_sideslip_deg', 'kept_m', 'min_speed_mps', 'brake_onset_m')
    return pd.DataFrame(rows, columns=['replicate', 'task', 'arm', 'avoided', *names])


def study(drives, exchanged=None):
    """Drives of arms and of the factorial as one table, as a study keeps them."""
    parts = [drives] if exchanged is None else [drives, exchanged.assign(start=0)]
    table = pd.concat(parts, ignore_index=True).assign(judged=True, error='')
    known = table.fillna({'stratum': 0, 'latency_ms': 0, 'compensated': False})
    return known.astype({'compensated': bool})


def trials(arms=('mpcc', 'frenet', 'mpcc_heading'), replicates=10, seed=3):
    """Points of searches whose costs fall."""
    rng = np.random.default_rng(seed)
    rows = []
    for arm in arms:
        for replicate in range(1, replicates + 1):
            for number in range(11):
                drives = 384 + 96 * number
                costs = rng.uniform(3.0, 9.0, 16) - 0.1 * number
                rows += [(replicate, arm, number, drives, cost, False) for cost in costs]
                rows.append((replicate, arm, number, drives, 4.0 - 0.1 * number, True))
    names = ['replicate', 'arm', 'round', 'drives', 'cost', 'is_recommended']
    return pd.DataFrame(rows, columns=names)
