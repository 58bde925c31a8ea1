"""One drive of the study: a setting, a controller, a perturbation of the start."""

import hashlib
import json
import math
import time
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from bags.evaluation.drive import Drive, drive_from_columns
from bags.evaluation.metrics.outcome import SLIDING_DEG
from bags.evaluation.series import SIDESLIP_FROM
from bags.storage.columns import Columns
from experiments import code_version, simulation
from experiments.settings import arms, measures, plant_variants
from experiments.settings.arms import Arm
from experiments.settings.course import NAME
from experiments.settings.plan import Plan
from experiments.settings.setting import Setting
from experiments.simulation import Setup
from msgs_yaml.types import VehicleState
from node_runtime import parameters, provenance
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario

ANY_SCENARIO = 'double_lane_change'  # to load a controller; an arm sets what it decides
ROOTS = (*code_version.ROOTS, 'experiments.settings.drive')


class DriveTask(NamedTuple):
    """Which setting is driven by whom; it can be sent to another process."""

    setting: Setting
    name: str  # of the arm
    arm: Arm
    perturbation: int  # its number
    start: Plan
    preconditions: Plan  # what braking means

    def __repr__(self) -> str:
        return f'DriveTask({self.setting.number}, {self.name}, {self.perturbation})'

    @property
    def formulation(self) -> str:
        """Equal for controllers that solve equal problems."""
        options = {k: v for k, v in self.arm.settings.items() if k.startswith('formulation.')}
        family = 'frenet' if self.arm.controller == 'frenet' else 'mpcc'
        circles = len(self.arm.settings['body.circle_offsets_m'])
        return f'{family} {circles} {sorted(options.items())}'


def plan_drive(
    plan: Plan,
    setting: Setting,
    name: str,
    perturbation: int = 0,
    tuned: Mapping[str, Any] = arms.NO_PARAMETERS,
) -> DriveTask:
    """Return a drive of the study; perturbations count from 0, which changes nothing."""
    arm = arms.build(plan, setting, name, tuned)
    start = plan.perturbations[perturbation]
    return DriveTask(setting, name, arm, perturbation, start, plan.preconditions)


@cache
def controller_digest(controller: str) -> str:
    """Return the SHA-256 of every parameter of a controller's file and of those it is based on."""
    params = simulation.prepare(ANY_SCENARIO, controller).params
    return provenance.digest(repr(sorted(parameters.flatten(params).items())))


def key(task: DriveTask) -> str:
    """Return the SHA-256 of all that decides a drive: scenario, parameters, code, processor."""
    setting = task.setting
    content = [
        code_version.digest(ROOTS),
        setting.text,
        sorted(setting.plant.settings.items()),
        setting.values['latency_ms'],
        setting.plant.limit,
        [setting.radius, setting.offsets],
        plant_variants.digest(setting.values['car']),
        task.arm.controller,
        controller_digest(task.arm.controller),
        # the name of the car file is a digest of what is in it, its folder that of a machine
        sorted({**task.arm.settings, 'car_file': Path(setting.plant.car_file).name}.items()),
        [task.start.speed_mps, task.start.y_m],
        task.preconditions.P4.brake_n,
    ]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def prepare(task: DriveTask) -> Setup:
    """Return the setup of a drive. Raises BagError for parameters that nobody has."""
    setting = task.setting
    scn = scenario.parse(setting.text, NAME)
    plant = dict(setting.plant.settings) | {'command_delay_ms': setting.values['latency_ms']}
    # another machine of a cluster has the file elsewhere, or is yet to identify the car
    car_file = plant_variants.build(plant_variants.variant_of(setting.values)).car_file
    controller = {**task.arm.settings, 'car_file': car_file}
    setup = simulation.prepare_scenario(
        scn, task.arm.controller, {'controller': controller, 'plant': plant}
    )
    start = setup.scn.start
    start = start._replace(speed=start.speed + task.start.speed_mps, Y=start.Y + task.start.y_m)
    return setup._replace(scn=setup.scn._replace(start=start))


def is_over(task: DriveTask, scn: Scenario, state: VehicleState) -> bool:
    """Return whether nothing after a state counts.

    The car has lost control as the metric `lost` has it, its centre is beside the road, or, with
    collision avoidance, it is in an obstacle: contact is not simulated.
    """
    speed, sideslip = math.hypot(state.vx, state.vy), math.atan2(state.vy, state.vx)
    if speed > SIDESLIP_FROM and abs(sideslip) > math.radians(SLIDING_DEG):
        return True
    if not scn.edges.right[0, 1] < state.Y < scn.edges.left[0, 1]:
        return True
    half_width = task.setting.plant.width / 2
    return task.name != arms.NO_CA and any(
        math.hypot(state.X - disc.X, state.Y - disc.Y) < disc.r_obs + half_width
        for disc in scn.obstacles.items
    )


def simulate(task: DriveTask) -> tuple[Drive, dict[str, Columns]]:
    """Drive once, until it `is_over`; return the Drive and its columns. Raises BagError."""
    setup = prepare(task)
    columns = simulation.run(setup, explain=False, give_up=partial(is_over, task, setup.scn))
    return drive_from_columns(columns, simulation.run_info(setup), setup.controller), columns


def run(task: DriveTask) -> str:
    """Drive once; return the measures as JSON, with the wall and processor time [s]."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    drive, columns = simulate(task)
    values = measures.measure(drive, columns, task.setting, task.preconditions.P4)
    values['wall_s'] = time.perf_counter() - wall_s
    values['cpu_s'] = time.process_time() - cpu_s
    return json.dumps(values, allow_nan=False)
