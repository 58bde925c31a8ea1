"""What is known of actuators that do not follow, and what is done then. SI units; stamps in ns.

Plans begin where such an actuator is. Where set-points arrive late, plans begin when they arrive.
Beside lost brakes forces are those of the other axle alone: ramps, plans, and the laws without a
plan; not the braking after an exception, which takes nothing from here.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import braking, setpoints
from mpcc_controller.driving.delay_compensation import SetpointRamp, constant_ramp
from mpcc_controller.driving.late_setpoints import DelayEstimate
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import Limits
from msgs_yaml.conversions import NS_PER_S, ns_to_s
from msgs_yaml.types import Actuators, Command

FAULT = 'actuators.fault'  # in the report
STEER, FORCE, LATE = 'steer', 'force', 'late'  # its words
FRONT, REAR = 'front', 'rear'  # likewise: the brakes of this axle are lost
CONFIRM_S, CLEAR_S = 0.18, 1.0  # four ticks in a row; a manoeuvre without a difference
PROBE_SHARE = 0.1  # of the other axle's force: what lost brakes are asked for, so that they tell
# a sticking steering is not asked for more than this beyond where it is: it may come free
LEAD_RAD = 0.1


class ActuatorCheck(NamedTuple):
    """What the newest message of the actuators says."""

    age_s: float | None  # of the message when the state was measured; None: of an earlier tick
    measured: Setpoints
    steer_error: float  # rad beyond the set-points of the last while, 0 within them
    force_error: float  # N, the same
    faults: tuple[str, ...]  # of STEER, FORCE, LATE, FRONT, REAR
    late_ns: int  # delay of the set-points beyond what is known


class Persistence(NamedTuple):
    """Whether something is so since it was so for a while."""

    holds: bool = False
    agreed_ns: int | None = None  # when it last was as `holds` says

    def update(self, is_so: bool, stamp_ns: int) -> 'Persistence':
        """Return what holds after a message."""
        if self.agreed_ns is None or is_so == self.holds:
            return Persistence(self.holds, stamp_ns)
        if stamp_ns - self.agreed_ns >= (CLEAR_S if self.holds else CONFIRM_S) * NS_PER_S:
            return Persistence(is_so, stamp_ns)
        return self


class ActuatorState(NamedTuple):
    """What is known of the actuators after a tick, at first nothing."""

    start: Actuators | None = None  # where set-points began
    last: Actuators | None = None
    check: ActuatorCheck | None = None  # None where nothing is known of the actuators
    persistences: tuple[Persistence, Persistence] = (Persistence(), Persistence())
    delay: DelayEstimate = DelayEstimate()
    sticks: bool = False  # whether the steering does not move at all
    stands: bool = False  # whether it stands where it should move: it sticks, or is late
    followed: bool = False  # whether it was seen to follow without a delay
    lost: str = ''  # FRONT or REAR: an axle without brakes
    lost_by: tuple[str, ...] = ()  # the same, as the last messages tell it

    @property
    def steers(self) -> bool:
        """Whether nothing tells that the steering does not move as it is asked to."""
        return not (self.sticks or self.stands)

    @property
    def faults(self) -> tuple[str, ...]:
        """What does not follow, of STEER and FORCE, LATE set-points, and FRONT or REAR."""
        return self.check.faults if self.check else ()

    @property
    def held(self) -> dict[str, float]:
        """Where the actuators are that do not follow, by the field of their set-point."""
        fields = {'delta': STEER, 'Fx': FORCE}
        return {k: getattr(self.check.measured, k) for k, v in fields.items() if v in self.faults}

    def begin(self, now: Setpoints, limits: Limits) -> Setpoints:
        """Return where a plan begins: at `now`, and where an actuator does not follow, there."""
        ranges = {
            'delta': (-limits.steer_rad, limits.steer_rad),
            'Fx': (-limits.brake_n, limits.drive_n),
        }
        held = {k: min(max(v, ranges[k][0]), ranges[k][1]) for k, v in self.held.items()}
        return now._replace(**held)

    def acting(self, ramps: Sequence[SetpointRamp]) -> Sequence[SetpointRamp]:
        """Return ramps of what acts on the car: of an actuator with a fault where it is."""
        held = self.held
        if not held:
            return ramps
        return tuple(
            ramp._replace(begin=ramp.begin._replace(**held), end=ramp.end._replace(**held))
            for ramp in ramps
        )

    @property
    def lost_force(self) -> str:
        """The force of a command that lost brakes do not give, '' where none are lost."""
        return {FRONT: 'Fxf', REAR: 'Fxr'}.get(self.lost, '')

    def left_of(self, ramp: SetpointRamp) -> SetpointRamp:
        """Return a ramp of what the other axle brakes with beside lost brakes."""
        if not self.lost:
            return ramp
        front = 0.0 if self.lost == FRONT else 1.0
        share = ramp.lambda_b if front else 1 - ramp.lambda_b
        ends = [p._replace(Fx=share * p.Fx if p.Fx < 0 else p.Fx) for p in (ramp.begin, ramp.end)]
        return ramp._replace(begin=ends[0], end=ends[1], lambda_b=front)

    def setpoints_of(self, command: Command, car: Car) -> tuple[Setpoints, float]:
        """Return `setpoints.setpoints_of` of a command without lost brakes."""
        ramp = self.left_of(constant_ramp(*setpoints.setpoints_of(command, car)))
        return ramp.end, ramp.lambda_b

    def limits_left(self, limits: Limits, car: Car) -> Limits:
        """Return the limits of a car that brakes with the axle that is left, on its friction."""
        if not self.lost:
            return limits
        share = 0.0 if self.lost == FRONT else 1.0
        left = replace(limits, brake_front_share_min=share, brake_front_share_max=share)
        return replace(left, brake_n=braking.max_braking_force(0.0, car, left))

    def probing(self, command: Command, last: Command, limits: Limits, step_s: float) -> Command:
        """Return a command that asks lost brakes for a little, to see whether they are back.

        That is reached from the `last` command within the rate limit of the whole force.
        """
        if not self.lost:
            return command
        lost, other = self.lost_force, 'Fxr' if self.lost == FRONT else 'Fxf'
        force, before = getattr(command, other), getattr(last, lost)
        if before < 0:  # no axle drives while the other one is asked to brake
            force = min(force, 0.0)
        rest, most = before - force + getattr(last, other), limits.force_rate_nps * step_s
        wanted = getattr(command, lost) + PROBE_SHARE * min(force, 0.0)
        asked = min(max(wanted, rest - most), rest + most)
        if force < 0:  # by rounding, too, no axle drives then
            asked = min(asked, 0.0)
        return command._replace(**{other: force, lost: asked})

    def target_from(
        self,
        target: SetpointTarget,
        start: Setpoints,
        now: Setpoints,
        car: Car,
        limits: Limits,
        step_s: float,
    ) -> SetpointTarget:
        """Return the set-points to send for a target that was planned from `start`.

        The set-points `now` change by as much as the plan does: of an actuator that is off by an
        amount or a share, only that leads to the target. A driving force is not asked for beyond
        the plan, steering not further beyond where it is.
        """
        if not self.held:
            return target
        delta, Fx, lambda_b = target
        if STEER in self.faults and not self.sticks:  # it would come free far from there
            measured = self.check.measured.delta
            lead = max(LEAD_RAD, abs(now.delta - measured))
            delta = np.clip(now.delta + delta - start.delta, measured - lead, measured + lead)
            delta = float(np.clip(delta, -limits.steer_rad, limits.steer_rad))
        if FORCE in self.faults:
            Fx = min(now.Fx + Fx - start.Fx, max(Fx, 0.0))
            Fz = single_track.loads(Fx, car)
            grip = limits.friction_use * (car.mu_f * Fz.f + car.mu_r * Fz.r)
            Fx = float(np.clip(Fx, -min(limits.brake_n, grip), limits.drive_n))
            lambda_b = setpoints.split_within_friction(lambda_b, Fx, car, limits)
        return setpoints.within_rates(SetpointTarget(delta, Fx, lambda_b), now, limits, step_s)

    def describe(self) -> str:
        """Return a line for the log: where actuators are that do not follow their set-points."""
        if not self.faults:
            return 'the actuators follow their set-points'
        check, off = self.check, 'beyond what was asked for, plans begin there'
        angle = f'steering angle {check.measured.delta:.3f} rad'
        texts = {
            STEER: f'{angle}, {check.steer_error:+.3f} rad {off}',
            FORCE: f'force {check.measured.Fx:.0f} N, {check.force_error:+.0f} N {off}',
            FRONT: 'the brakes in front are lost, the car brakes with those of the rear axle',
            REAR: 'the brakes of the rear axle are lost, the car brakes with those in front',
            LATE: f'set-points arrive {1e3 * ns_to_s(check.late_ns):.0f} ms late, plans begin then',
        }
        if self.sticks:
            texts[STEER] = f'{angle}, which does not move, the car stops'
        return f'actuators do not follow: {"; ".join(texts[name] for name in self.faults)}'
