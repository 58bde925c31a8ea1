"""One tick: from a state and what earlier ticks left to a command and what this one leaves.

Pure but for the clock: equal arguments give equal results, and nothing is changed in place. No ROS;
SI units; stamps and instants in ns.

The instants of a tick, with the names that they have here:

    stamp_ns      stamp_ns + age_s     effective_ns            due_ns
    |-------------|--------------------|-----------------------|--------------> time
    the state     the step begins:     the command takes       the set-points are
    is measured   the state was        effect, after           reached; the next state
                  received before      computing, transport    is measured

`effective_ns` is expected from earlier ticks. In lockstep no time passes while the controller
computes: `age_s` is 0 and the command takes effect at `stamp_ns`. The next state is measured one
`model.step_s` after this one. In a car that is known, or was found, to delay its commands,
`effective_ns` and `due_ns` are `command_ns` later.

Three cars appear: the `measured` state, at `stamp_ns`; the `predicted` state, at `effective_ns`,
from which the tick plans; and the `modelled` car, the parameters of the prediction model with the
friction that is believed.
"""

from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import (
    braking,
    last_resort,
    measurement_errors,
    obstacle_prediction,
    path_progress,
    planner,
    recovery,
    setpoints,
)
from mpcc_controller.driving.choose import Candidacy
from mpcc_controller.driving.delay_compensation import (
    WINDOW,
    SetpointRamp,
    expected_delay,
    predict,
    shifted,
    still_needed,
)
from mpcc_controller.driving.fallback import BRAKING, RECOVERY, Decision
from mpcc_controller.driving.friction_estimate import FrictionBelief
from mpcc_controller.driving.gate import UNTIMELY
from mpcc_controller.driving.last_resort import INTERNAL_ERROR
from mpcc_controller.driving.parts import Parts
from mpcc_controller.driving.records import Attempt, Memory, TickInputs, TickRecord
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.driving.watchdog import STATE_STALE
from mpcc_controller.in_force import least_driven
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import NS_PER_S, add_seconds, ns_to_s
from msgs_yaml.types import Command, VehicleState

MOST_RAMPS = 20  # kept after an error: those of the longest delay, known and found
NOT_FINITE = 'state_not_finite'
TOO_SLOW = 'too_slow'
PATH_ENDED = 'path_ended'
STEERING_STICKS, STEERING_STANDS = 'steering_sticks', 'steering_stands'
REJECTED = 'command_turned_back'  # by the gate
STANDS_MPS = 0.3  # a slower car that is to stop is held with the brakes


class Now(NamedTuple):
    """What a tick plans from."""

    measured: VehicleState  # the state that is answered, as it is estimated
    predicted: VehicleState  # when the command takes effect
    sliding: bool  # whether the predicted car slides and is to be recovered
    start: Setpoints  # when the command takes effect
    world: Scene  # with its obstacles where they are then
    modelled: Car  # on the road that is believed
    effective_ns: int  # when the command takes effect


def tick(
    memory: Memory, inputs: TickInputs, scene: Scene, parts: Parts
) -> tuple[Memory, TickRecord]:
    """Return the command that answers a state, with everything that led to it."""
    began, before = parts.clock(), memory
    memory, now, friction = _sense(memory, inputs, scene, parts)
    parts = parts.with_faults(memory.actuators, memory.believed)
    # guess, solve and choose, or take a lower level of the ladder
    memory, decision, x0, attempt = _decide(memory, now, inputs.fault, parts)
    memory, command, line = _act(memory, decision, attempt is not None, now, parts)
    # gate
    age_s = inputs.age_s + (parts.clock() - began if parts.limit_time else 0.0)
    brakes = parts.model.car_to_brake(memory.believed)
    checked = parts.gate.check(command, before.last, age_s, brakes)
    rejections = [checked.reason] if checked.reason else []
    if checked.reason and checked.reason not in UNTIMELY:
        memory = memory._replace(plans=memory.plans.discard(), candidacy=Candidacy())
        if decision.plan is not None:
            memory, decision = planner.brake(memory, REJECTED, now.sliding)
            memory, command, line = _act(memory, decision, False, now, parts)
            checked = parts.gate.check(command, before.last, age_s, brakes)
            rejections += [checked.reason] if checked.reason else []
    # remember
    command, reason = checked.command, rejections[0] if rejections else ''
    computing_s = parts.clock() - began
    memory = _remember(memory, command, decision, now.effective_ns, rejections, parts)
    memory = memory._replace(slid=now.sliding, resumed=False)
    if not inputs.fault:  # braking takes no time and says nothing about the next solve
        memory = memory._replace(computing_s=(*memory.computing_s, computing_s)[-WINDOW:])
    return memory, TickRecord(
        inputs=inputs,
        command=command,
        decision=decision,
        effective_ns=now.effective_ns,
        state=now.predicted,
        scene=now.world,
        x0=x0,
        attempt=attempt,
        braking_line=line,
        friction=friction,
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
    measured, params = inputs.state, parts.params_to_brake
    step_ns, limits = round(params.model.step_s * NS_PER_S), params.limits
    line, points = braking.NONE, None
    if scene.path is not None:
        line, points = braking.PATH, scene.path.table[:2].T
    longest_ns = params.fallback.max_guide_age * params.model.step_s * NS_PER_S
    if memory.planned_line and 0 <= measured.stamp_ns - memory.planned_line[0] <= longest_ns:
        line, points = braking.PLAN, memory.planned_line[1]
    grip = memory.believed / params.model.friction
    modelled = parts.model.car._replace(
        mu_f=grip * parts.model.car.mu_f, mu_r=grip * parts.model.car.mu_r
    )
    command = last_resort.braking_command(
        measured, memory.last, points, modelled, limits, params.braking, params.model.step_s
    )
    command_ns = parts.command_ns + memory.actuators.delay.late_ns  # no function of the tick
    effective_ns = inputs.effective_ns
    if effective_ns is None:
        effective_ns = measured.stamp_ns + command_ns
    due_ns = max(measured.stamp_ns + command_ns + step_ns, effective_ns)
    force, active = command.Fxf + command.Fxr, memory.ramps[-1]
    share = command.Fxf / force if force < 0 else active.lambda_b
    ramp = SetpointRamp(effective_ns, active.end, due_ns, Setpoints(command.delta, force), share)
    resumed = memory.resumed
    plans = memory.plans._replace(plan=None, age=0, good_age=memory.plans.good_age + 1)
    memory = memory._replace(
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
        state=measured,
        scene=scene,
        braking_line=line,
        rejections=memory.rejections,
        computing_s=parts.clock() - began,
        resumed=resumed,
    )


def _sense(
    memory: Memory, inputs: TickInputs, scene: Scene, parts: Parts
) -> tuple[Memory, Now, FrictionBelief | None]:
    """Return what a tick plans from, and the friction where it is estimated.

    That is the estimated state, and the world that is predicted.
    """
    params, received = parts.params, inputs.state
    measured = measurement_errors.measured_state(received, params.measurement_errors)
    stamp_ns, effective_ns = measured.stamp_ns, inputs.effective_ns
    # actuators, and the ramps that act
    actuators = parts.actuators.update(memory.actuators, inputs.actuators, memory.ramps, stamp_ns)
    if actuators.delay.late_ns != memory.actuators.delay.late_ns:
        later_ns = actuators.delay.late_ns - memory.actuators.delay.late_ns
        memory = memory._replace(ramps=shifted(memory.ramps, later_ns))
    if actuators.lost != memory.actuators.lost:
        memory = memory._replace(ramps=tuple(map(actuators.left_of, memory.ramps)))
    memory = memory._replace(actuators=actuators)
    command_ns = memory.command_ns(parts.command_ns)
    if effective_ns is None:  # not known: when it is expected
        effective_ns = at_once_ns = stamp_ns + command_ns
        if parts.limit_time:
            delay_s = expected_delay(memory.computing_s, inputs.age_s, params.delay)
            # a state may be a little early: the actuators reach the last set-point first
            earliest = max(add_seconds(at_once_ns, delay_s), memory.ramp.end_ns)
            effective_ns = min(earliest, add_seconds(at_once_ns, params.delay.longest_s))
    # the friction, and the velocities
    ramps, belief = actuators.acting(memory.ramps), None
    if parts.friction is not None:
        friction = parts.friction.update(memory.friction, measured, ramps)
        belief = parts.friction.belief(friction)
        memory = memory._replace(friction=friction, believed=belief.friction)
        measured = parts.friction.filtered(friction, measured)
    tracks = obstacle_prediction.observe(memory.tracks, scene, received, stamp_ns, params)
    modelled = parts.model.car_on(memory.believed)
    # without a delay of commands the states between two effects are under the last ramp alone
    begin, acting, known = measured, ramps if command_ns else ramps[-1:], memory.known
    if np.all(np.isfinite(measured)):
        known = measured
    elif known is not None:  # predicted from, while not older than a plan may be to steer along
        longest_s = params.fallback.max_guide_age * params.model.step_s
        if 0 <= ns_to_s(stamp_ns - known.stamp_ns) <= longest_s:
            begin, acting = known, ramps
        else:
            known = None
    predicted = predict(begin, acting, effective_ns, modelled)
    memory = memory._replace(tracks=tracks, known=known)
    now = Now(
        measured,
        predicted,
        sliding=bool(params.fallback.recovery)
        and recovery.is_sliding(predicted, modelled, memory.slid),
        start=actuators.begin(memory.ramp.end, params.limits),
        world=obstacle_prediction.scene_at(tracks, scene, effective_ns),
        modelled=modelled,
        effective_ns=effective_ns,
    )
    return memory, now, belief


def missing(scene: Scene) -> tuple[str, ...]:
    """Return the names of the inputs that were never set."""
    return tuple(name for name, value in scene._asdict().items() if value is None)


def _decide(
    memory: Memory, now: Now, fault: str, parts: Parts
) -> tuple[Memory, Decision, State | None, Attempt | None]:
    """Return the plan to drive, or the lower level of the ladder, and what was solved for it.

    With it stage 0, None where no plan could be attempted.
    """
    params, (measured, predicted, sliding, start, world, modelled, _) = parts.params, now
    if fault == STATE_STALE or not np.all(np.isfinite(measured)):
        reason = fault if fault == STATE_STALE else NOT_FINITE
        since_ns = measured.stamp_ns - memory.last.stamp_ns
        ticks = round(since_ns / (params.model.step_s * NS_PER_S))
        return *planner.continue_plan(memory, reason, ticks, modelled, parts), None, None
    least = least_driven(params.limits)
    margin = params.limits.speed_hysteresis_mps if memory.is_too_slow else 0.0
    is_too_slow = bool(predicted.vx < least + margin)
    memory = memory._replace(is_too_slow=is_too_slow)
    lacking = missing(world)
    if lacking:
        return *planner.brake(memory, f'no_{lacking[0]}', sliding), None, None
    progress, x0 = path_progress.initial_state(
        memory.progress, predicted, start, world, memory.plans.plan, params
    )
    memory = memory._replace(progress=progress)
    reason = fault or (TOO_SLOW if is_too_slow else '')
    # past a path that ends in a stop the plan ends there, and a car that stands is held
    path = world.path
    stops = not params.limits.least_speed_mps and path.ends_in_stop and predicted.vx > STANDS_MPS
    if not reason and x0.theta > path.length and not stops:
        reason = PATH_ENDED
    # Without steering the car brakes. Braking also changes the forces: if these follow at once, the
    # set-points are not late, and the steering sticks.
    if not reason and not memory.actuators.steers:
        reason = STEERING_STICKS if memory.actuators.sticks else STEERING_STANDS
    if reason:
        slides = sliding and reason not in (STEERING_STICKS, STEERING_STANDS)  # recovery steers
        return *planner.brake(memory, reason, slides), x0, None
    memory, decision, attempt = planner.plan(memory, x0, world, modelled, sliding, parts)
    return memory, decision, x0, attempt


def _act(
    memory: Memory, decision: Decision, is_new: bool, now: Now, parts: Parts
) -> tuple[Memory, Command, str | None]:
    """Return the command that drives a decision, before the gate; `is_new`: a plan of this tick.

    With it the line that a braking car steers along, None with a plan.
    """
    params, (measured, predicted, _, start, world, modelled, _) = parts.params, now
    step_s, limits, line = params.model.step_s, parts.params_to_brake.limits, None
    if decision.plan is not None:
        target = setpoints.target_of_plan(decision.plan, modelled, params.limits)
        if not is_new:  # an old plan, perhaps of several ticks ago
            target = setpoints.within_rates(target, start, limits, step_s)
    else:
        theta = None
        if world.path is not None and np.all(np.isfinite(predicted)):
            reach_m = params.surroundings.path_search_m
            near = memory.progress.theta
            theta = path_progress.find_theta(world.path, predicted, near, reach_m)
            memory = memory._replace(progress=memory.progress._replace(theta=theta))
        guide = memory.plans.guide(params.fallback)
        line, ahead = braking.lookahead_point(predicted, guide, world.path, theta, params.braking)
        if decision.level == RECOVERY:
            law, braked = recovery.recovery_target, modelled
        else:
            law, braked = braking.braking_target, parts.model.car_to_brake(memory.believed)
            if not memory.actuators.steers:
                law = partial(law, steers=False)
        target = law(predicted, start, ahead, braked, parts.params_to_brake)
    sent = memory.ramp.end
    target = memory.actuators.target_from(target, start, sent, modelled, limits, step_s)
    command = setpoints.command_to(target, sent, modelled, step_s, measured.stamp_ns)
    command = memory.actuators.probing(command, memory.last, limits, step_s)
    return memory, command, line


def _remember(memory: Memory, command: Command, decision, effective_ns, rejections, parts: Parts):
    """Return the memory with a command that is sent."""
    step_s, modelled = parts.params.model.step_s, parts.model.car_on(memory.believed)
    command_ns = memory.command_ns(parts.command_ns)
    due_ns = max(add_seconds(command.stamp_ns, step_s) + command_ns, effective_ns)
    end, lambda_b = memory.actuators.setpoints_of(command, modelled)
    ramp = SetpointRamp(effective_ns, memory.ramp.end, due_ns, end, lambda_b)
    # The next tick predicts from a later state, or from the last one that was known. Actuators and
    # friction are compared with set-points from before it.
    acted_s = max(parts.actuators.memory_s, parts.friction.memory_s if parts.friction else 0.0)
    known_ns = command.stamp_ns
    if memory.known is not None:
        known_ns = min(known_ns, memory.known.stamp_ns)
    kept = still_needed(memory.ramps, add_seconds(known_ns, -acted_s))
    counts = dict(memory.rejections)
    for reason in rejections:
        counts[reason] = counts.get(reason, 0) + 1
    planned = memory.planned_line
    if decision.plan is not None:
        planned = command.stamp_ns, decision.plan.X[:, :2]
    return memory._replace(
        last=command, ramps=(*kept, ramp), rejections=counts, planned_line=planned
    )
