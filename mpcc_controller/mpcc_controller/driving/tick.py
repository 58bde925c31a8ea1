"""One tick: from a state and what earlier ticks left to a command and what this one leaves.

Pure but for the clock: equal arguments give equal results, and nothing is changed in place. No ROS;
SI units; stamps and instants in ns.
"""

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mpcc_controller import minimum_speed
from mpcc_controller.driving import (
    braking,
    delay_compensation,
    last_resort,
    measurement_errors,
    obstacle_perception,
    path_progress,
    planner,
    recovery,
    setpoints,
)
from mpcc_controller.driving.choose import Candidacy
from mpcc_controller.driving.delay_compensation import SetpointRamp, predict, still_needed
from mpcc_controller.driving.fallback import BRAKING, RECOVERY, Decision
from mpcc_controller.driving.friction_estimate import FrictionBelief
from mpcc_controller.driving.gate import UNTIMELY
from mpcc_controller.driving.internal_errors import INTERNAL_ERROR
from mpcc_controller.driving.parts import Parts
from mpcc_controller.driving.records import Memory, TickInputs, TickRecord
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.driving.watchdog import STATE_STALE
from mpcc_controller.model.single_track import Car
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import NS_PER_S, add_seconds, ns_to_s
from msgs_yaml.types import Command, VehicleState

MOST_RAMPS = 10  # kept after an error: those of the longest delay
NOT_FINITE = 'state_not_finite'
TOO_SLOW = 'too_slow'
PATH_ENDED = 'path_ended'
REJECTED = 'command_turned_back'  # by the gate
STANDS_MPS = 0.3  # a slower car that is to stop is held with the brakes


class Now(NamedTuple):
    """What a tick plans from."""

    measured: VehicleState  # the state that is answered, as it is estimated
    state: VehicleState  # when the command takes effect
    start: Setpoints  # then
    world: Scene  # with its obstacles where they are then
    car: Car  # on the road that is believed
    effective_ns: int  # when the command takes effect


def tick(
    memory: Memory, inputs: TickInputs, scene: Scene, parts: Parts
) -> tuple[Memory, TickRecord]:
    """Return the command that answers a state, with everything that led to it."""
    began, before = parts.clock(), memory
    memory, now, belief = _sense(memory, inputs, scene, parts)
    # guess, solve and choose, or take a lower level of the ladder
    memory, decision, x0, attempt = _decide(memory, now, inputs.fault, parts)
    memory, command, line = _act(memory, decision, attempt is not None, now, parts)
    # gate
    age_s = inputs.age_s + (parts.clock() - began if parts.limit_time else 0.0)
    state, car = now.state, now.car
    brakes = parts.model.car_to_brake(memory.believed)
    checked = parts.gate.check(command, before.last, age_s, brakes)
    rejections = [checked.reason] if checked.reason else []
    if checked.reason and checked.reason not in UNTIMELY:
        memory = replace(memory, plans=memory.plans.discard(), candidacy=Candidacy())
        if decision.plan is not None:
            sliding = is_sliding(state, car, memory.slid, parts)
            memory, decision = planner.brake(memory, REJECTED, sliding)
            memory, command, line = _act(memory, decision, False, now, parts)
            checked = parts.gate.check(command, before.last, age_s, brakes)
            rejections += [checked.reason] if checked.reason else []
    # remember
    command, reason = checked.command, rejections[0] if rejections else ''
    computing_s = parts.clock() - began
    memory = _remember(memory, command, decision, now.effective_ns, rejections, parts)
    memory = replace(memory, slid=is_sliding(state, car, before.slid, parts), resumed=False)
    if not inputs.fault:  # braking takes no time and says nothing about the next solve
        window = delay_compensation.WINDOW
        memory = replace(memory, computing_s=(*memory.computing_s, computing_s)[-window:])
    return memory, TickRecord(
        inputs=inputs,
        command=command,
        decision=decision,
        effective_ns=now.effective_ns,
        state=state,
        scene=now.world,
        x0=x0,
        attempt=attempt,
        braking_line=line,
        friction=belief,
        actuators=memory.actuators.check,
        gate_reason=reason,
        rejections=memory.rejections,
        prepared_s=memory.prepared_s,
        computing_s=computing_s,
        resumed=before.resumed,
    )


def brake_after_error(
    memory: Memory, inputs: TickInputs, scene: Scene, parts: Parts, began: float
) -> tuple[Memory, TickRecord]:
    """Return the command in place of that of a tick that raised and `began` at an instant [s].

    `memory` is that from before the tick. What the tick measures is remembered if it can be: the
    friction of the road and faults of actuators may change while ticks raise. The command itself
    needs nothing that a tick calls. The next solve starts cold.
    """
    with suppress(Exception):
        memory, _, _ = _sense(memory, inputs, scene, parts)
    x, params = inputs.state, parts.params_to_brake
    step_ns, limits = round(params.model.step_s * NS_PER_S), params.limits
    line, points = braking.NONE, None
    if scene.path is not None:
        line, points = braking.PATH, scene.path.table[:2].T
    longest_ns = params.fallback.max_guide_age * params.model.step_s * NS_PER_S
    if memory.guide and 0 <= x.stamp_ns - memory.guide[0] <= longest_ns:
        line, points = braking.PLAN, memory.guide[1]
    grip = memory.believed / params.model.friction
    car = parts.model.car._replace(
        mu_f=grip * parts.model.car.mu_f, mu_r=grip * parts.model.car.mu_r
    )
    command = last_resort.braking_command(
        x, memory.last, points, car, limits, params.braking, params.model.step_s
    )
    effective_ns = inputs.effective_ns
    if effective_ns is None:
        effective_ns = x.stamp_ns + parts.command_ns
    due_ns = max(x.stamp_ns + parts.command_ns + step_ns, effective_ns)
    force, active = command.Fxf + command.Fxr, memory.ramps[-1]
    share = command.Fxf / force if force < 0 else active.lambda_b
    ramp = SetpointRamp(effective_ns, active.end, due_ns, Setpoints(command.delta, force), share)
    resumed = memory.resumed
    plans = memory.plans._replace(plan=None, age=0, good_age=memory.plans.good_age + 1)
    memory = replace(
        memory,
        last=command,
        ramps=(*memory.ramps[-MOST_RAMPS:], ramp),
        plans=plans,
        candidacy=Candidacy(),
        resumed=False,
    )
    return memory, TickRecord(
        inputs=inputs,
        command=command,
        decision=Decision(BRAKING, INTERNAL_ERROR, None),
        effective_ns=effective_ns,
        state=x,
        scene=scene,
        braking_line=line,
        rejections=memory.rejections,
        computing_s=parts.clock() - began,
        resumed=resumed,
    )


def _sense(
    memory: Memory, inputs: TickInputs, scene: Scene, parts: Parts
) -> tuple[Memory, Now, FrictionBelief | None]:
    """Return what a tick plans from: the estimated state, and the world that is predicted."""
    x = measurement_errors.measured_state(inputs.state, parts.params.measurement_errors)
    effective_ns = inputs.effective_ns
    if effective_ns is None:
        effective_ns = _effective_ns(memory, x, inputs.age_s, parts)
    memory, ramps, belief, x = _estimate(memory, x, inputs, parts)
    car = parts.model.car_on(memory.believed)
    start = memory.actuators.begin(memory.ramp.end, parts.params.limits)
    memory, state = _state_at(memory, x, effective_ns, ramps, car, parts)
    sightings = obstacle_perception.observe(
        memory.sightings, scene, inputs.state, x.stamp_ns, parts.params
    )
    memory = replace(memory, sightings=sightings)
    world = world_at(memory, scene, x.stamp_ns, effective_ns, parts)
    return memory, Now(x, state, start, world, car, effective_ns), belief


def world_at(memory: Memory, scene: Scene, seen_ns: int, stamp_ns: int, parts: Parts) -> Scene:
    """Return the scene as seen at an instant, with its obstacles moved to another."""
    known = obstacle_perception.scene_known(memory.sightings, scene, seen_ns, parts.params)
    return stage_parameters.scene_at(known, stamp_ns)


def is_sliding(x: VehicleState, car: Car, slid: bool, parts: Parts) -> bool:
    """Return whether the car slides and is to be recovered."""
    return bool(parts.params.fallback.recovery) and recovery.is_sliding(x, car, slid)


def missing(scene: Scene) -> tuple[str, ...]:
    """Return the names of the inputs that were never set."""
    return tuple(name for name, value in scene._asdict().items() if value is None)


def _effective_ns(memory: Memory, x: VehicleState, age_s: float, parts: Parts) -> int:
    """Return when the command that answers `x` will take effect."""
    received_ns = x.stamp_ns + parts.command_ns
    if not parts.limit_time:
        return received_ns
    delay = parts.params.delay
    delay_s = delay_compensation.expected_delay(memory.computing_s, age_s, delay)
    # a state may be a little early: the actuators reach the last set-point first
    earliest = max(add_seconds(received_ns, delay_s), memory.ramp.end_ns)
    return min(earliest, add_seconds(received_ns, delay.longest_s))


def _estimate(memory: Memory, x: VehicleState, inputs: TickInputs, parts: Parts):
    """Return what is known of actuators and friction, the ramps that act, and the velocities."""
    actuators = parts.actuators.update(memory.actuators, inputs.actuators, memory.ramps, x.stamp_ns)
    ramps = actuators.acting(memory.ramps)
    memory = replace(memory, actuators=actuators)
    if parts.friction is None:
        return memory, ramps, None, x
    friction = parts.friction.update(memory.friction, x, ramps)
    belief = parts.friction.belief(friction)
    memory = replace(memory, friction=friction, believed=belief.friction)
    return memory, ramps, belief, parts.friction.filtered(friction, x)


def _state_at(
    memory: Memory, x: VehicleState, effective_ns: int, ramps, car: Car, parts: Parts
) -> tuple[Memory, VehicleState]:
    """Return the state at which the command takes effect.

    It is predicted from `x`; where that is not known, from the last state that was, while that is
    not older than a plan may be to steer along.
    """
    # without a delay of commands the states between two effects are under the last ramp alone
    acting = ramps if parts.command_ns else ramps[-1:]
    known = memory.known
    if np.all(np.isfinite(x)):
        known = x
    elif known is not None:
        params = parts.params
        longest_s = params.fallback.max_guide_age * params.model.step_s
        if 0 <= ns_to_s(x.stamp_ns - known.stamp_ns) <= longest_s:
            return memory, predict(known, ramps, effective_ns, car)
        known = None
    return replace(memory, known=known), predict(x, acting, effective_ns, car)


def _decide(memory: Memory, now: Now, fault: str, parts: Parts):
    """Return (memory, decision, stage 0 or None, attempt or None)."""
    params, (measured, x, start, world, car, _) = parts.params, now
    sliding = is_sliding(x, car, memory.slid, parts)
    if fault == STATE_STALE or not np.all(np.isfinite(measured)):
        reason = fault if fault == STATE_STALE else NOT_FINITE
        since_ns = measured.stamp_ns - memory.last.stamp_ns
        ticks = round(since_ns / (params.model.step_s * NS_PER_S))
        memory, decision = planner.continue_plan(memory, reason, ticks, car, parts)
        return memory, decision, None, None
    least = minimum_speed.least_driven(params.limits)
    margin = params.limits.speed_hysteresis_mps if memory.is_too_slow else 0.0
    is_too_slow = bool(x.vx < least + margin)
    memory = replace(memory, is_too_slow=is_too_slow)
    lacking = missing(world)
    if lacking:
        memory, decision = planner.brake(memory, f'no_{lacking[0]}', sliding)
        return memory, decision, None, None
    progress, x0 = path_progress.initial_state(
        memory.progress, x, start, world, memory.plans.plan, params
    )
    memory = replace(memory, progress=progress)
    reason = fault or (TOO_SLOW if is_too_slow else '')
    # past a path that ends in a stop the plan ends there, and a car that stands is held
    path = world.path
    stops = not params.limits.least_speed_mps and path.ends_in_stop and x.vx > STANDS_MPS
    if not reason and x0.theta > path.length and not stops:
        reason = PATH_ENDED
    if reason:
        memory, decision = planner.brake(memory, reason, sliding)
        return memory, decision, x0, None
    memory, decision, attempt = planner.plan(memory, x0, world, car, sliding, parts)
    return memory, decision, x0, attempt


def _act(memory: Memory, decision: Decision, is_new: bool, now: Now, parts: Parts):
    """Return (memory, command, line): the line along which the car brakes, None with a plan."""
    params, (measured, x, start, world, car, _) = parts.params, now
    step_s, limits, line = params.model.step_s, parts.params_to_brake.limits, None
    if decision.plan is not None:
        target = setpoints.target_of_plan(decision.plan, car, params.limits)
        if not is_new:  # an old plan, perhaps of several ticks ago
            target = setpoints.within_rates(target, start, limits, step_s)
    else:
        theta = None
        if world.path is not None and np.all(np.isfinite(x)):
            reach_m = params.surroundings.path_search_m
            theta = path_progress.project(memory.progress, x, world.path, reach_m)
            memory = replace(memory, progress=memory.progress._replace(theta=theta))
        guide = memory.plans.guide(params.fallback)
        line, ahead = braking.lookahead_point(x, guide, world.path, theta, params.braking)
        recovers = decision.level == RECOVERY
        law = recovery.recovery_target if recovers else braking.braking_target
        believed = car if recovers else parts.model.car_to_brake(memory.believed)
        target = law(x, start, ahead, believed, parts.params_to_brake)
    sent = memory.ramp.end
    target = memory.actuators.target_from(target, start, sent, car, limits, step_s)
    return memory, setpoints.command_to(target, sent, car, step_s, measured.stamp_ns), line


def _remember(memory: Memory, command: Command, decision, effective_ns, rejections, parts: Parts):
    """Return the memory with a command that is sent."""
    step_s, car = parts.params.model.step_s, parts.model.car_on(memory.believed)
    due_ns = max(add_seconds(command.stamp_ns, step_s) + parts.command_ns, effective_ns)
    end, lambda_b = setpoints.setpoints_of(command, car)
    ramp = SetpointRamp(effective_ns, memory.ramp.end, due_ns, end, lambda_b)
    # The next tick predicts from a later state, or from the last one that was known; the estimate
    # of the friction compares the two, under the set-points that acted `actuator_delay_s` before,
    # and the actuators are compared with those of a longer while.
    acted_s = parts.params.friction_estimate.actuator_delay_s if parts.friction else 0.0
    acted_s = max(acted_s, parts.actuators.memory_s)
    known_ns = command.stamp_ns
    if memory.known is not None:
        known_ns = min(known_ns, memory.known.stamp_ns)
    kept = still_needed(memory.ramps, add_seconds(known_ns, -acted_s))
    counts = dict(memory.rejections)
    for reason in rejections:
        counts[reason] = counts.get(reason, 0) + 1
    guide = memory.guide
    if decision.plan is not None:
        guide = command.stamp_ns, decision.plan.X[:, :2]
    return replace(memory, last=command, ramps=(*kept, ramp), rejections=counts, guide=guide)
