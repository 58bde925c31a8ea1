"""What ticks work with: parameters, and what is built from them once. SI units."""

import copy
import dataclasses
import time
from collections.abc import Callable

from mpcc_controller.car_file import EMERGENCY_LIMITS
from mpcc_controller.driving.actuator_faults import ActuatorState
from mpcc_controller.driving.actuator_monitor import ActuatorMonitor
from mpcc_controller.driving.friction_estimate import FrictionEstimator
from mpcc_controller.driving.gate import Gate
from mpcc_controller.driving.prediction_model import PredictionModel
from mpcc_controller.driving.tick_solvers import TickSolvers
from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml.conversions import NS_PER_S
from node_runtime.parameters import ParameterError

# parameters of `candidates` that may be left out where plans are compared
OPTIONAL = ('regain_speed', 'explore_after_command')


class Parts:
    """The parts of one controller; of these only `change` changes anything between ticks.

    The solvers are workspaces: what they solved leaves no trace in what they solve next.
    """

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool,
        clock: Callable[[], float] = time.perf_counter,
    ):
        """`limit_time` lets the solvers stop at their wall-time limits; `clock` is in s."""
        self.limit_time, self.clock = limit_time, clock
        self.model = PredictionModel(params, vehicle)
        self.params = params = self.model.params  # with the limits of the car
        self.start_limits, self.params_to_brake = params.limits, params
        self.compares = (params.candidates.most or 1) > 1
        for name, value in vars(params.candidates).items() if self.compares else ():
            if value is None and name not in OPTIONAL:
                raise ParameterError(
                    f'candidates.{name}: is missing, and candidates.most is above 1; '
                    'allowed to be left out with candidates.most 1'
                )
        for name, value in vars(params.tracker).items():
            if value is None and params.tracker.position_m is not None:
                raise ParameterError(
                    f'tracker.{name}: is missing, and tracker.position_m is given; '
                    'allowed to be left out without that'
                )
        self.solvers = TickSolvers(self.model, limit_time, clock)
        self.command_ns = round((params.delay.command_s or 0.0) * NS_PER_S)
        self.actuators = ActuatorMonitor(vehicle)
        self.friction: FrictionEstimator | None = None
        if params.friction_estimate.on:
            highest = params.model.friction
            self.friction = FrictionEstimator(
                params.friction_estimate, self.model.car, self.actuators.lags, highest
            )
        self.gate = Gate(
            params.limits,
            self.model.car,
            params.model.step_s,
            params.fallback.max_state_age_s,
            vehicle.actuators.force_rate_nps,
        )

    def change(self, params: ControllerParams) -> None:
        """Plan and drive by other weights and limits from the next tick on.

        The gate and braking without a plan keep the limits of the start, where these are wider:
        what is changed while the controller drives restrains its plans, not its emergency brake.
        """
        self.model.change(params)
        self.params = self.model.params
        limits = dataclasses.replace(
            self.start_limits,
            **{
                name: max(getattr(self.params.limits, name), getattr(self.start_limits, name))
                for name in (*EMERGENCY_LIMITS, 'drive_n')
            },
        )
        self.gate = self.gate._replace(limits=limits)
        self.params_to_brake = dataclasses.replace(self.params, limits=limits)

    def with_faults(self, actuators: ActuatorState, believed: float) -> 'Parts':
        """Return the parts of a car on a friction that brakes in spite of faults.

        Beside lost brakes the other axle brakes alone; who cannot steer brakes as fast as the axles
        can. The parts solve with the same workspaces.
        """
        if actuators.steers and not actuators.lost:
            return self
        parts, car = copy.copy(self), self.model.car_to_brake(believed)
        parts.model = copy.copy(self.model)

        def limited(params, **rates):
            limits = dataclasses.replace(actuators.limits_left(params.limits, car), **rates)
            return dataclasses.replace(params, limits=limits)

        rates = {} if actuators.steers else {'force_rate_nps': self.gate.axle_rate_nps}
        parts.params = parts.model.params = limited(self.params)
        parts.params_to_brake = limited(self.params_to_brake, **rates)
        limits = dataclasses.replace(self.gate.limits, **rates)
        parts.gate = self.gate._replace(limits=limits, lost=actuators.lost_force)
        return parts
