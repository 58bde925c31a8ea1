"""The claims of the paper, one by one, as rules (see claim_rules)."""

from experiments.study.claim_rules import (
    AT_LIMIT,
    D_SFT,
    EARLIER_M,
    KEPT,
    NEAR_M,
    NOTICEABLE_MPS,
    OVERSHOOTS_M,
    PAPER_MAX_MS,
    PAPER_MEAN_MS,
    PERIOD_MS,
    SLIDES_DEG,
    STABLE_DEG,
    Claim,
    Shown,
)


def _avoids(run):
    return run.value('completed') and run.value('min_v2o_m') > 0.0


def _wide(run, at_m):
    return any(abs(one['x_m'] - at_m) <= NEAR_M for one in run.value('overshoots'))


def _onset(name, earlier_m):
    def holds(runs):
        ours, theirs = runs['mpcc'].value(name), runs['frenet'].value(name)
        if ours is None:
            return False
        return theirs is None or (ours < theirs and ours <= theirs - earlier_m)

    return holds


def _above(name, role, other):
    return lambda runs: runs[role].value(name) > runs[other].value(name)


def _gain(name, runs):
    return runs['mpcc'].value(name) - runs['frenet'].value(name)


def _all_roles(name, holds):
    return lambda runs: all(holds(run.value(name)) for run in runs.values())


def _both(name):
    return tuple(Shown(role, name) for role in ('mpcc', 'frenet'))


def _three(name):
    return tuple(Shown(role, name) for role in ('mpcc', 'mpcc_no_ca', 'frenet'))


def _within_paper(runs):
    solve = runs['mpcc'].value('solve_cpu_ms')
    return solve['mean'] <= PAPER_MEAN_MS and solve['max'] <= PAPER_MAX_MS


def _braking(name, key, force):
    return Claim(
        key,
        f'MPCC brakes 20 m before the baseline ({force})',
        '20 m earlier',
        _onset(name, EARLIER_M),
        f'MPCC brakes at least {EARLIER_M:g} m earlier, or the baseline never does',
        _onset(name, 0.0),
        'MPCC brakes earlier, or the baseline never does',
        _both(name),
        switched='frenet',
        undecided='a',
    )


SAFE_EDGE, SAFE_OBSTACLE = 'min_v2e_m', 'min_v2o_m'
CLAIMS = (
    Claim(
        'no_ca_collides',
        'MPCC without CA collides with obstacle 1',
        'V2O < 0',
        lambda runs: runs['mpcc_no_ca'].value('min_v2o_per_obstacle_m.1') < 0.0,
        'V2O < 0 at obstacle 1',
        lambda runs: runs['mpcc_no_ca'].value(SAFE_OBSTACLE) < 0.0,
        'V2O < 0 at any obstacle',
        (
            Shown('mpcc_no_ca', 'min_v2o_per_obstacle_m.1'),
            Shown('mpcc_no_ca', 'min_outline_gap_m'),
        ),
        switched='mpcc_no_ca',
        undecided='d',
    ),
    Claim(
        'both_avoid',
        'both controllers with CA avoid both obstacles',
        'V2O > 0',
        lambda runs: _avoids(runs['mpcc']) and _avoids(runs['frenet']),
        'both complete with V2O > 0',
        lambda runs: _avoids(runs['mpcc']) or _avoids(runs['frenet']),
        'one of them does',
        _both(SAFE_OBSTACLE),
        reason='the priority of the distances: MPCC without CA, which lacks nothing else, collides',
        undecided='ab',
    ),
    Claim(
        'baseline_unsafe',
        'the baseline enters the unsafe areas of obstacle 2 and of the right edge',
        'V2O < D_sft, V2E < D_sft',
        lambda runs: (
            runs['frenet'].value('min_v2o_per_obstacle_m.2') < D_SFT
            and runs['frenet'].value('min_v2e_per_edge_m.right') < D_SFT
        ),
        'below D_sft at obstacle 2 and at the right edge',
        lambda runs: runs['frenet'].value('entered_unsafe_area'),
        'below D_sft anywhere',
        (
            Shown('frenet', 'min_v2o_per_obstacle_m.2'),
            Shown('frenet', 'min_v2e_per_edge_m.right'),
        ),
        switched='frenet',
        undecided='ab',
    ),
    Claim(
        'mpcc_safe',
        'the MPCC stays out of the unsafe areas',
        'V2O, V2E >= D_sft',
        lambda runs: not runs['mpcc'].value('entered_unsafe_area'),
        'V2O and V2E >= D_sft throughout',
        lambda runs: min(runs['mpcc'].value(n) for n in (SAFE_OBSTACLE, SAFE_EDGE)) >= KEPT * D_SFT,
        f'V2O and V2E >= {KEPT:g} D_sft throughout',
        (Shown('mpcc', SAFE_OBSTACLE), Shown('mpcc', SAFE_EDGE)),
        switched='mpcc',
        undecided='ab',
    ),
    Claim(
        'overshoots',
        'the baseline overshoots near 125 m and 135 m',
        'at 125 m and 135 m',
        lambda runs: all(_wide(runs['frenet'], at) for at in OVERSHOOTS_M),
        f'one within {NEAR_M:g} m of each',
        lambda runs: any(_wide(runs['frenet'], at) for at in OVERSHOOTS_M),
        f'one within {NEAR_M:g} m of either',
        _both('overshoots'),
        switched='frenet',
        undecided='a',
    ),
    Claim(
        'sideslip',
        'sideslip peak of the baseline 9 deg against 3 deg',
        '9 deg, 3 deg',
        lambda runs: (
            runs['frenet'].value('peak_sideslip_deg') >= SLIDES_DEG
            and runs['mpcc'].value('peak_sideslip_deg') <= STABLE_DEG
        ),
        f'baseline >= {SLIDES_DEG:g} deg and MPCC <= {STABLE_DEG:g} deg',
        _above('peak_sideslip_deg', 'frenet', 'mpcc'),
        'baseline above MPCC',
        _both('peak_sideslip_deg'),
        switched='frenet',
        undecided='ab',
    ),
    _braking('brake_onset_at_m', 'brakes_earlier', '-500 N'),
    _braking('brake_onset_hard_at_m', 'brakes_earlier_hard', '-1500 N'),
    Claim(
        'min_speed',
        'the MPCC keeps a higher minimum speed',
        'higher',
        lambda runs: _gain('min_speed_mps', runs) >= NOTICEABLE_MPS,
        f'minimum speed of MPCC at least {NOTICEABLE_MPS:g} m/s above that of the baseline',
        _above('min_speed_mps', 'mpcc', 'frenet'),
        'above that of the baseline',
        _both('min_speed_mps'),
        switched='frenet',
        undecided='a',
    ),
    Claim(
        'lateral_limit',
        'all three reach the lateral limit',
        'all',
        _all_roles('peak_lat_acc_share', lambda share: share >= AT_LIMIT),
        f'all three reach {AT_LIMIT:g} mu g',
        lambda runs: any(run.value('peak_lat_acc_share') >= AT_LIMIT for run in runs.values()),
        'one of them does',
        _three('peak_lat_acc_share'),
        reason='entry speed and coarse path',
        undecided='ac',
    ),
    Claim(
        'braking_limit',
        'none reaches the braking limit',
        'none',
        _all_roles('peak_brake_share', lambda share: share < AT_LIMIT),
        f'all three stay below {AT_LIMIT:g} mu g',
        lambda runs: any(run.value('peak_brake_share') < AT_LIMIT for run in runs.values()),
        'one of them does',
        _three('peak_brake_share'),
        reason='the grip is used for steering around: the demanded speed stays reachable',
        undecided='a',
    ),
    Claim(
        'solve_time',
        'solved in real time: 15.6 ms on average, 18.6 ms at most',
        '15.6 / 18.6 ms',
        _within_paper,
        f'processor time: mean <= {PAPER_MEAN_MS:g} ms and max <= {PAPER_MAX_MS:g} ms',
        lambda runs: runs['mpcc'].value('solve_cpu_ms.max') < PERIOD_MS,
        f'processor time: max < {PERIOD_MS:g} ms, the period',
        (Shown('mpcc', 'solve_cpu_ms.mean'), Shown('mpcc', 'solve_cpu_ms.max')),
        reason='another solver on another processor: no statement on FORCESPro',
        undecided='f',
    ),
    Claim(
        'counter_steers',
        'the baseline needs to counter-steer',
        'baseline only',
        lambda runs: (
            runs['frenet'].value('counter_steer_s') >= 2 * runs['mpcc'].value('counter_steer_s')
            and _above('counter_steer_s', 'frenet', 'mpcc')(runs)
        ),
        'baseline steers against its turn at least twice as long',
        _above('counter_steer_s', 'frenet', 'mpcc'),
        'baseline steers against its turn longer',
        _both('counter_steer_s'),
        switched='frenet',
        undecided='a',
    ),
    Claim(
        'brakes_longer',
        'the baseline brakes for a longer time',
        'longer',
        _above('braking_s', 'frenet', 'mpcc'),
        'baseline below -500 N for longer',
        _above('braking_s', 'frenet', 'mpcc'),
        'the same',
        _both('braking_s'),
        switched='frenet',
        undecided='a',
    ),
)
# measured on the MPCC's own states, everything but the priority equal
GAUSSIAN, STEP = 'mpcc', 'frenet'
CONVERGENCE = Claim(
    'convergence',
    'the Gaussian priority converges faster and more robustly than the step',
    'faster, more robust',
    lambda runs: (
        runs[GAUSSIAN].value('solver.iterations_mean') < runs[STEP].value('solver.iterations_mean')
        and runs[GAUSSIAN].value('solver.failed') <= runs[STEP].value('solver.failed')
    ),
    'fewer iterations on average, and no more failed solves',
    _above('solver.iterations_mean', STEP, GAUSSIAN),
    'fewer iterations on average',
    tuple(
        Shown(role, name)
        for name in ('solver.iterations_mean', 'solver.failed', 'solve_cpu_ms.mean')
        for role in (GAUSSIAN, STEP)
    ),
    switched='frenet',
    undecided='e',
)
