"""Every number of the controller, with its unit and its allowed range; values live in config/."""

from typing import Annotated

from node_runtime import parameters
from node_runtime.parameters import Choice, Range, Struct

# the class of each formulation; a text, so that parameters are checked before a model is loaded
PROBLEMS = 'mpcc_controller.problem'
FORMULATIONS = {
    'mpcc': f'{PROBLEMS}.mpcc_formulation:MpccFormulation',
    'frenet': f'{PROBLEMS}.frenet_formulation:FrenetFormulation',
    'tracking': f'{PROBLEMS}.mpcc_formulation:TrackingFormulation',
}
PROJECTED, INTEGRATED = 'projected', 'integrated'  # values of model.theta
CONVERGED, ONE_STEP = 'converged', 'one_step'  # of solver.mode
FREE, FIXED = 'free', 'fixed'  # of formulation.brake_split
FROZEN, REFRESHED = 'frozen', 'refreshed'  # of surroundings.arcs
TRACKER, LIDAR, CAMERA = 'tracker', 'lidar', 'camera'  # of measurement_errors.preset


class Model(Struct):
    """Prediction horizon, and how the model treats the limits of its validity."""

    horizon: Annotated[int, Range(5, 200, 'steps')]
    step_s: Annotated[float, Range(0.01, 0.2, 's')]  # length of a step of the prediction
    tyre_switch: Annotated[float, Range(0.5, 1.0, 'share of the slip of full sliding')]
    least_slip_speed_mps: Annotated[float, Range(1.0, 10.0, 'm/s')]
    force_blend_n: Annotated[float, Range(1.0, 1e4, 'N, from braking to driving')]
    friction: Annotated[float, parameters.ROAD_FRICTION]  # believed, 1 = as identified
    # in place of the car's; 0 is rear-wheel drive
    drive_front_share: Annotated[float, Range(0.0, 1.0, '-')] | None
    # whether actuators follow their set-points with the lags of `car_file`; left out: without lag
    servo_lag: bool | None
    # whether the model holds down to standstill (kinematic when slow), which ends
    # limits.least_speed_mps; left out: false
    low_speed: bool | None
    # theta of stage 0: of the point of the path closest to the car, or as the last plan predicted
    # it, as in the paper; left out: projected
    theta: Annotated[str, Choice(PROJECTED, INTEGRATED)] | None


class Formulation(Struct):
    """Which problem is solved: its functions, and which weights are 0."""

    name: Annotated[str, Choice(*FORMULATIONS)]
    distance: Annotated[str, Choice('cartesian', 'path')]  # where D is measured; frenet: path
    priority: Annotated[str, Choice('gaussian', 'step')]  # how a distance counts
    lag: bool  # whether the lag error costs; frenet has none
    heading: bool  # whether the heading error costs; in the paper only that of the baseline
    # whether the front share of the braking force is an input; left out: free
    brake_split: Annotated[str, Choice(FREE, FIXED)] | None
    # of a fixed split; left out: `in_force.FRONT_SHARE`
    brake_front_share: Annotated[float, Range(0.0, 1.0, '- of the braking force')] | None


class Body(Struct):
    """The circles that stand for the vehicle."""

    circle_radius_m: Annotated[float, Range(0.1, 5.0, 'm')]  # of each circle
    circle_offsets_m: Annotated[tuple[float, ...], Range(-5.0, 5.0, 'm ahead of the CoG')]
    # that cover the outline of `car_file`, in place of those above; left out: those above
    circles: Annotated[int, Range(1, 9, 'circles')] | None
    # of the circles at road edges; left out: their radius, with `circles` half of the car's width
    edge_radius_m: Annotated[float, Range(0.1, 5.0, 'm')] | None


class Tolerances(Struct):
    """The error that costs 1: a weight is 1 / tolerance^2."""

    contouring_m: Annotated[float, Range(1e-3, 1e3, 'm')]  # distance from the path, across
    # distance along the path from the point at theta
    lag_m: Annotated[float, Range(1e-3, 1e3, 'm')]
    heading_rad: Annotated[float, Range(1e-3, 1e3, 'rad from the path')]
    velocity_mps: Annotated[float, Range(1e-3, 1e3, 'm/s')]  # from the desired speed
    steer_rate_radps: Annotated[float, Range(1e-3, 1e3, 'rad/s')]
    force_rate_nps: Annotated[float, Range(1.0, 1e7, 'N/s')]  # of the total longitudinal force
    brake_split: Annotated[float, Range(1e-3, 1e3, '-')]
    slack_m: Annotated[float, Range(1e-3, 1e3, 'm outside the road, m/s below the least speed')]
    # left out: the term is not in the problem
    lateral_jerk_mps3: Annotated[float, Range(1e-1, 1e6, 'm/s^3')] | None
    # of the excess over the shares of `Envelope`; left out: likewise
    front_slip_excess_rad: Annotated[float, Range(1e-4, 1e3, 'rad')] | None
    # of the rear axle, likewise
    rear_slip_excess_rad: Annotated[float, Range(1e-4, 1e3, 'rad')] | None
    # of the yaw rate, likewise
    yaw_rate_excess_radps: Annotated[float, Range(1e-4, 1e3, 'rad/s')] | None
    # of the gap that lacks to `Envelope.time_gap_s`, likewise (mpcc only)
    time_gap_lack_m: Annotated[float, Range(1e-3, 1e3, 'm')] | None


class Envelope(Struct):
    """Where the soft limits begin, of stable handling as shares; 1 where left out.

    A limit is in the problem where `Tolerances` has its tolerance.
    """

    front_slip: Annotated[float, Range(0.1, 2.0, 'share of the slip of full sliding')] | None
    rear_slip: Annotated[float, Range(0.1, 2.0, 'share of the slip of full sliding')] | None
    yaw_rate: (
        Annotated[float, Range(0.1, 2.0, 'share of the yaw rate that the friction keeps')] | None
    )
    # to others ahead that move, in whose strip the plan is
    time_gap_s: Annotated[float, Range(0.1, 10.0, 's of driving')] | None


class Priorities(Struct):
    """Weights P_k of distances to obstacles and edges: the largest, or before contact (`step`)."""

    obstacle: Annotated[float, Range(0.0, 1e6, '1/m^2')]  # of obstacles; 0: they are not avoided
    edge: Annotated[float, Range(0.0, 1e6, '1/m^2')]  # of road edges; 0: they are not avoided


class SafetyDistances(Struct):
    """D_sft: nearer than this costs."""

    # between a circle of the car and an obstacle
    obstacle_m: Annotated[float, Range(1e-2, 10.0, 'm')]
    edge_m: Annotated[float, Range(1e-2, 10.0, 'm')]  # between a circle of the car and an edge
    # whether edge_m is at most the room beside a car in the middle of the road (not of frenet);
    # left out: false
    fit_edges: bool | None


class Limits(Struct):
    """The largest values that the controller commands; `car_file` cuts them to those of the car."""

    steer_rad: Annotated[float, Range(0.01, 1.0, 'rad at the road wheel, either way')]
    steer_rate_radps: Annotated[float, Range(0.01, 10.0, 'rad/s')]
    brake_n: Annotated[float, Range(0.0, 1e5, 'N, both axles')]
    drive_n: Annotated[float, Range(0.0, 1e5, 'N, both axles')]
    force_rate_nps: Annotated[float, Range(1.0, 1e7, 'N/s')]  # of the total longitudinal force
    brake_front_share_min: Annotated[float, Range(0.0, 1.0, '-')]  # lambda_b, lower limit
    brake_front_share_max: Annotated[float, Range(0.0, 1.0, '-')]  # lambda_b, upper limit
    friction_use: Annotated[float, Range(0.1, 1.0, 'share of mu Fz (sf)')]
    # the same of a driving force, which spins the wheels beyond it; left out: friction_use
    drive_friction_use: Annotated[float, Range(0.1, 1.0, 'share of mu Fz')] | None
    least_speed_mps: Annotated[float, Range(1.0, 50.0, 'm/s, below it the car brakes to a stop')]
    # above the least speed, to drive on
    speed_hysteresis_mps: Annotated[float, Range(0.0, 10.0, 'm/s')]


class Surroundings(Struct):
    """How much of the world enters the problem."""

    max_obstacles: Annotated[int, Range(1, 32, 'discs of obstacles at a time')]
    path_search_m: Annotated[float, Range(1.0, 1e3, 'm, projection around the last foot')]
    edge_window_m: Annotated[float, Range(0.1, 20.0, 'm, edge heading and curvature')]
    # whether the centre of the track is beside the path where the road widens (not of frenet);
    # left out: false
    align_track: bool | None
    # left out: none does. Tracked obstacles that move along the road, or against it, may follow it
    follow_road_rad: Annotated[float, Range(0.0, 1.0, 'rad, angle to the road, at most')] | None
    # of path, road edges and obstacles around each stage: those around the guess, or again around
    # the plan until it stays near them; left out: frozen
    arcs: Annotated[str, Choice(FROZEN, REFRESHED)] | None
    # left out: such a path is refused
    path_speed_mps: (
        Annotated[float, Range(1.0, 100.0, 'm/s, of a path whose poses have one stamp')] | None
    )


class Tracker(Struct):
    """How obstacles are tracked and predicted; left out: each keeps its velocity."""

    # of what is received of an obstacle; left out: obstacles are not tracked, and the others may be
    # left out, too
    position_m: Annotated[float, Range(1e-3, 10.0, 'm, standard deviation per axis')] | None
    velocity_mps: Annotated[float, Range(1e-3, 10.0, 'm/s, standard deviation per axis')] | None
    jerk_mps3: (
        Annotated[float, Range(0.1, 100.0, 'm/s^2, change of acceleration in 1 s, likely')] | None
    )
    missed: Annotated[float, Range(1e-6, 0.9, 'probability that a message lacks one')] | None
    # every hypothesis above it counts, by a radius that leaves so much to all of them together
    contact: Annotated[float, Range(1e-3, 0.5, 'probability of an obstacle beyond its disc')] | None


class Solver(Struct):
    """How the problem is solved."""

    mode: Annotated[str, Choice(CONVERGED, ONE_STEP)]
    one_step_residual: Annotated[float, Range(0.0, 1.0, 'primal, in the units of the solver')]
    one_step_decrease: Annotated[float, Range(0.0, 1e3, 'share of the cost that a step promises')]
    prepare: bool  # solve the expected next problem after each command
    max_iterations: Annotated[int, Range(1, 10000, 'iterations')]
    # of the optimality conditions, in solver units
    tolerance: Annotated[float, Range(1e-12, 1e-1, '-')]
    time_limit_s: Annotated[float, Range(1e-3, 10.0, 's, realtime only')]
    patience_s: Annotated[float, Range(1e-3, 10.0, 's, to wait for other plans, realtime only')]


class Delay(Struct):
    """From a state to the effect of its command; all but `command_s` realtime only."""

    computing_s: Annotated[float, Range(0.0, 0.05, 's, expected until it has been measured')]
    transport_s: Annotated[float, Range(0.0, 0.05, 's, from the controller to the actuators')]
    longest_s: Annotated[float, Range(0.0, 0.2, 's, more is not predicted')]
    # left out: 0. In lockstep too, beyond `longest_s`
    command_s: Annotated[float, Range(0.0, 0.2, 's, from the actuators to the effect')] | None


class FrictionEstimate(Struct):
    """How the friction of the road is estimated from the motion; off: `model.friction` holds."""

    on: bool | None  # left out: off, and the others may be left out
    lowest: Annotated[float, Range(0.05, 1.5, '-, the lowest friction that is believed')] | None
    # the friction that is believed is exceeded with a probability of 1 - quantile
    quantile: Annotated[float, Range(0.001, 0.999, '-')] | None
    # before there is evidence: mostly a little less than `model.friction`, perhaps anything
    spread: Annotated[float, Range(1e-3, 1.0, '-, friction over which it is e times rarer')] | None
    doubt: Annotated[float, Range(1e-6, 0.999, '-, probability of any friction alike')] | None
    memory_s: Annotated[float, Range(0.1, 1e3, 's, evidence fades by 1/e')] | None
    # what the model predicts wrongly over a tick, and what is measured wrongly
    speed_noise_mps: Annotated[float, Range(1e-3, 10.0, 'm/s, standard deviation')] | None
    lateral_noise_mps: Annotated[float, Range(1e-3, 10.0, 'm/s, standard deviation')] | None
    yaw_rate_noise_radps: Annotated[float, Range(1e-4, 10.0, 'rad/s, standard deviation')] | None
    sideslip_error_rad: Annotated[float, Range(0.0, 0.2, 'rad, likely error, constant')] | None
    # what the lags of car_file are wrong by, and delays that nobody tells
    lag_error_s: Annotated[float, Range(0.0, 0.2, 's, standard deviation')] | None


PositionBias = Annotated[float, Range(-5.0, 5.0, 'm, position in the frame of the car')]
PositionNoise = Annotated[float, Range(0.0, 5.0, 'm, standard deviation per axis')]
AngleBias = Annotated[float, Range(-0.5, 0.5, 'rad')]
SpeedNoise = Annotated[float, Range(0.0, 5.0, 'm/s, standard deviation')]


class MeasurementErrors(Struct):
    """Errors that the controller adds to what it receives, a test option; left out: none."""

    seed: Annotated[int, Range(0, 2**31 - 1, '-, of noise and dropouts; left out: 0')] | None
    ahead_bias_m: PositionBias | None
    left_bias_m: PositionBias | None
    yaw_bias_rad: AngleBias | None  # constant error of the heading
    speed_error: Annotated[float, Range(-0.5, 0.5, 'share of the speed')] | None
    # constant error of the sideslip angle
    sideslip_bias_rad: AngleBias | None
    position_noise_m: PositionNoise | None
    yaw_noise_rad: Annotated[float, Range(0.0, 0.5, 'rad, standard deviation')] | None
    speed_noise_mps: SpeedNoise | None
    lateral_speed_noise_mps: SpeedNoise | None
    yaw_rate_noise_radps: Annotated[float, Range(0.0, 1.0, 'rad/s, standard deviation')] | None
    obstacle_range_m: Annotated[float, Range(0.1, 1e4, 'm, farther ones are not seen')] | None
    obstacle_noise_m: PositionNoise | None
    obstacle_dropout: Annotated[float, Range(0.0, 1.0, 'share of the time')] | None
    obstacle_dropout_s: Annotated[float, Range(0.01, 10.0, 's, each; left out: 0.05')] | None
    obstacle_velocity_noise_mps: SpeedNoise | None
    # their positions are so old, which the message does not tell
    obstacle_latency_s: Annotated[float, Range(0.0, 1.0, 's')] | None
    # with something that is not there, for 0.3 s each
    obstacle_ghosts: Annotated[float, Range(0.0, 1.0, 'share of the time')] | None
    # with the ids of two exchanged, for 0.5 s each
    obstacle_swaps: Annotated[float, Range(0.0, 1.0, 'share of the time')] | None
    # the errors of obstacles that are left out are those of such a source
    preset: Annotated[str, Choice(TRACKER, LIDAR, CAMERA)] | None


class Ages(Struct):
    """How old an input may be, realtime only; from half of it on there is a warning."""

    state_s: Annotated[float, Range(0.01, 10.0, 's, then it drives without a state')]
    reference_s: Annotated[float, Range(0.1, 60.0, 's, path and road edges')]
    obstacles_s: Annotated[float, Range(0.05, 10.0, 's')]


class Warming(Struct):
    """What happens before the first command, realtime only."""

    steps: Annotated[int, Range(0, 1000, 'steps without a command, until memory and times settle')]


class Fallback(Struct):
    """When a plan is good enough, and what happens when there is none."""

    acceptable_residual: Annotated[float, Range(1e-9, 1.0, 'primal, in the units of the solver')]
    max_plan_age: Annotated[int, Range(0, 50, 'ticks')]
    failures_to_cold_start: Annotated[int, Range(1, 100, 'failed solves in a row')]
    max_guide_age: Annotated[int, Range(0, 50, 'ticks, to steer along the plan while braking')]
    max_state_age_s: Annotated[float, Range(1e-3, 10.0, 's, the gate rejects older commands')]
    # counter-steer a car that slides without a plan; left out: false, it is braked
    recovery: bool | None


class Braking(Struct):
    """How the car steers while it brakes without a plan."""

    preview_s: Annotated[float, Range(0.1, 5.0, 's of driving to the point that is steered to')]
    least_preview_m: Annotated[float, Range(1.0, 50.0, 'm')]  # at least so far ahead
    lateral_use: Annotated[float, Range(0.0, 1.0, 'share of the usable friction, at most')]


class Candidates(Struct):
    """How many plans a tick compares, and when it changes from one to another.

    Recordings made before hold none of them: one plan, the paper's controller.
    """

    most: Annotated[int, Range(1, 8, 'plans of a tick, 1: only the followed one')] | None
    danger_m: Annotated[float, Range(0.0, 20.0, 'm beyond the safety distance')] | None
    switch_share: Annotated[float, Range(0.0, 1.0, 'share of the cost, to change the plan')] | None
    hold_share: Annotated[float, Range(0.0, 1.0, 'the same after a switch')] | None
    hold_ticks: Annotated[int, Range(0, 100, 'ticks after a switch')] | None
    path_share: Annotated[float, Range(0.0, 10.0, 'share of the cost against the path')] | None
    max_iterations: Annotated[int, Range(1, 1000, 'iterations, but for the followed plan')] | None
    retry_ticks: Annotated[int, Range(0, 100, 'ticks until a useless guess is tried again')] | None
    # whether the speed that a plan lacks at its end counts in the choice; left out: false
    regain_speed: bool | None
    # whether new guesses are solved after the command where the followed plan is good; likewise
    explore_after_command: bool | None


class ControllerParams(Struct):
    """One controller, one file."""

    car_file: str  # in config/, or a path
    formulation: Formulation
    model: Model
    body: Body
    tolerances: Tolerances
    envelope: Envelope
    priorities: Priorities
    safety: SafetyDistances
    limits: Limits
    surroundings: Surroundings
    tracker: Tracker
    solver: Solver
    candidates: Candidates
    delay: Delay
    friction_estimate: FrictionEstimate
    measurement_errors: MeasurementErrors
    ages: Ages
    warm_up: Warming
    fallback: Fallback
    braking: Braking


class CarBody(Struct):
    """Masses and lengths of the car."""

    mass_kg: Annotated[float, Range(100.0, 1e5, 'kg')]  # with driver
    yaw_inertia_kgm2: Annotated[float, Range(10.0, 1e6, 'kg m^2')]  # about the CoG
    cog_to_front_m: Annotated[float, Range(0.1, 10.0, 'm')]  # CoG to the front axle
    cog_to_rear_m: Annotated[float, Range(0.1, 10.0, 'm')]  # CoG to the rear axle
    cog_height_m: Annotated[float, Range(0.0, 3.0, 'm')]  # above the road
    # half the air density times the drag area
    drag_n_per_mps2: Annotated[float, Range(0.0, 10.0, 'N/(m/s)^2')]
    rolling_n: Annotated[float, Range(0.0, 1e4, 'N')]  # rolling resistance


class Tyre(Struct):
    """Fiala tyres of both axles, identified on the plant."""

    # cornering stiffness of the axle
    front_cornering_npr: Annotated[float, Range(1e3, 1e6, 'N/rad')]
    # cornering stiffness of the axle
    rear_cornering_npr: Annotated[float, Range(1e3, 1e6, 'N/rad')]
    front_friction: Annotated[float, Range(0.05, 3.0, '-')]  # lateral force over load when sliding
    rear_friction: Annotated[float, Range(0.05, 3.0, '-')]  # lateral force over load when sliding
    # by how much the front wheels give way to the lateral force of their axle; without: not at all
    compliance_radpn: Annotated[float, Range(0.0, 1e-4, 'rad/N')] | None


class CarActuators(Struct):
    """How the car is driven, and the most that its actuators do."""

    drive_front_share: Annotated[float, Range(0.0, 1.0, '-, 0 = rear-wheel drive')]
    steer_rad: Annotated[float, Range(0.01, 2.0, 'rad at the road wheel, either way')]
    steer_rate_radps: Annotated[float, Range(0.01, 20.0, 'rad/s')]  # of the road-wheel angle
    brake_n: Annotated[float, Range(0.0, 1e5, 'N, both axles')]
    drive_n: Annotated[float, Range(0.0, 1e5, 'N, both axles')]
    force_rate_nps: Annotated[float, Range(1.0, 1e7, 'N/s')]  # of the slower axle
    # behind a set-point that moves at a constant rate; older files do not have them
    steer_lag_s: Annotated[float, Range(0.0, 1.0, 's')] | None
    # the same of the total force while braking
    force_lag_s: Annotated[float, Range(0.0, 1.0, 's')] | None


class CarOutline(Struct):
    """The rectangle of the car seen from above; older files do not have it."""

    front_m: Annotated[float, Range(0.1, 20.0, 'm, CoG to the front end')] | None
    rear_m: Annotated[float, Range(0.1, 20.0, 'm, CoG to the rear end')] | None
    width_m: Annotated[float, Range(0.1, 5.0, 'm')] | None  # of the body


class CarParams(Struct):
    """The car as the controller sees it; `identify` of vehicle_plant writes the file."""

    car: CarBody
    tyre: Tyre
    actuators: CarActuators
    outline: CarOutline
