"""Time per 1 ms step of the plant, in microseconds: docs/plant.md.

    .venv/bin/python bench/plant.py

`step_us` is the compiled integrator in bursts of 50 steps, as the node calls it in lockstep; the
target is 15.
"""

import statistics
import time

import numpy as np

from vehicle_plant import integrator, parameters, road_friction
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.simulator import TICK_STEPS, Simulator

BURSTS = 400


def per_step_us(call, steps: int, repeats: int) -> list[float]:
    """Return the time per step of each repeat."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append((time.perf_counter() - begin) / steps * 1e6)
    return times


def measure() -> dict[str, float]:
    """Drive a swerve in bursts of 50 steps, as the node does; and the bare integrator."""
    params = parameters.load()
    p = integrator.parameter_vector(params, 1.0)
    x = rolling_state(params, Start(0.0, 0.0, 0.0, 25.0))
    swerve = np.column_stack([0.1 * np.sin(np.arange(TICK_STEPS + 1) / 10)] + [np.zeros(51)] * 2)
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 25.0))
    strips = [
        [i, 0.0, i + 1.0, 0.0, i + 1.0, 4.0, float(i), 4.0]
        for i in range(road_friction.MAX_PATCHES)
    ]
    some = road_friction.patch_array(np.ravel(strips), [0.5] * road_friction.MAX_PATCHES)
    bare = per_step_us(lambda: integrator.advance(x, swerve, p), TICK_STEPS, BURSTS)
    patchy = per_step_us(lambda: integrator.advance(x, swerve, p, patches=some), TICK_STEPS, BURSTS)
    burst = per_step_us(lambda: car.advance(None, TICK_STEPS), TICK_STEPS, BURSTS)
    single = per_step_us(lambda: car.advance(None, 1), 1, BURSTS)
    return {
        'step_us': statistics.median(bare),
        'step_p99_us': float(np.percentile(bare, 99)),
        'step_with_16_patches_us': statistics.median(patchy),
        'simulator_burst_us': statistics.median(burst),
        'simulator_burst_p99_us': float(np.percentile(burst, 99)),
        'simulator_single_step_us': statistics.median(single),
    }


if __name__ == '__main__':
    for name, value in measure().items():
        print(f'{name:<28}{value:10.2f}')
