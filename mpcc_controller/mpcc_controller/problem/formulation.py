"""What every formulation is; the list of them is `parameters.FORMULATIONS`.

Outside a formulation a plan is in the map: its states are `single_track.State`, its theta the
distance along the path. Inside it is in the states of the problem that is solved ("local").
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from pkgutil import resolve_name
from typing import Any, ClassVar

import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import FORMULATIONS, INTEGRATED, PROJECTED, ControllerParams
from mpcc_controller.path import reference_path
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem import cost_terms, stage_parameters
from mpcc_controller.problem.cost_terms import CostTerm
from mpcc_controller.problem.distance_frame import FRAMES
from mpcc_controller.problem.ocp import Rules, SafetyDistance, SymbolicOcp, VehicleCircles
from mpcc_controller.problem.stage_parameters import CONSTANTS, Scene, StageParameters
from node_runtime.parameters import ParameterError
from stage_solver.stage_problem import Plan


class Formulation:
    """One optimal control problem: what the planner needs to know of it.

    A subclass sets the class variables and gives its stages their parameters.
    """

    state: ClassVar[type]  # a NamedTuple that has vx, vy, r, delta and Fx
    stage: ClassVar[type]  # a NamedTuple: CONSTANTS, then what differs from stage to stage
    # of `stage`: what it has beside that of all formulations
    template: ClassVar[tuple[tuple[str, Any], ...]]
    rates: ClassVar[Callable]  # (x, u, p) -> dx/dt
    quantities: ClassVar[Callable]  # (x, u or None, p, rules) -> StageQuantities
    constraints: ClassVar[Callable]  # (x, u, p) -> Constraints
    tuned_weights: ClassVar[tuple[str, ...]]  # parameters of the weights that tuning varies
    integrates_theta: ClassVar[bool]  # whether model.theta may be integrated
    terms: ClassVar[Sequence[CostTerm]]

    def __init__(self, params: ControllerParams, car: Car):
        self.car, frame = car, FRAMES[params.formulation.distance]
        priority = cost_terms.PRIORITIES[params.formulation.priority]
        terms = cost_terms.in_use(self.terms, params)
        self.rules = Rules(frame, priority, terms, single_track.structure(car))
        size = len(params.body.circle_offsets_m), params.surroundings.max_obstacles
        self.ocp = symbolic_ocp(type(self), params.formulation.name, *size, self.rules)
        self.set_params(params)

    def set_params(self, params: ControllerParams) -> None:
        """Take other weights and limits into the parameters of the stages."""
        self.params, terms, body = params, self.rules.terms, params.body
        at_edges = body.circle_radius_m if body.edge_radius_m is None else body.edge_radius_m
        values = (
            self.car,
            cost_terms.weights(terms, params),
            SafetyDistance(params.safety.obstacle_m, params.safety.edge_m),
            VehicleCircles(body.circle_radius_m, tuple(body.circle_offsets_m), at_edges),
            cost_terms.limits(terms, params),
            params.limits.least_speed_mps,
        )
        self.constants = dict(zip(CONSTANTS, values, strict=True))
        self.constant_numbers = stage_parameters.constant_numbers(values)

    def stage_parameters(
        self, scene: Scene, guess: np.ndarray, car: Car | None = None
    ) -> StageParameters:
        """Return the parameters of every stage around guessed states in the map (N + 1, 9).

        `car` is `self.car` with the friction that is believed now; None: with its own.
        """
        values, numbers = self.constants, self.constant_numbers
        if car is not None and car is not self.car:
            values = values | {'car': car}
            numbers = np.concatenate((car, numbers[len(car) :]))
        frame, x = self.rules.frame, self.place(scene.path, State(*guess.T))
        arcs, v_ref = reference_path.arcs_at(scene.path, x.theta)
        window = self.params.surroundings.edge_window_m
        slots, obstacles, places = stage_parameters.obstacle_slots(
            self.params, frame, scene, x, guess
        )
        values = values | {'edges': frame.road(scene.road, arcs, x, window), 'obstacles': slots}
        stages = self.stage(**values | self.own_parameters(scene, x, arcs, v_ref))
        return stage_parameters.to_matrix(stages, obstacles, places, len(guess), numbers)

    def place(self, path: ReferencePath, x: State) -> State:
        """Return guessed states with theta where the parameters of the stages are taken."""
        return x

    def own_parameters(
        self, scene: Scene, x: State, arcs: Arc, v_ref: np.ndarray
    ) -> dict[str, Any]:
        """Return the parameters of `stage` that differ between formulations, by name.

        `arcs` and the desired speeds `v_ref` [m/s] are those of the path at theta of `x`.
        """
        raise NotImplementedError

    def to_local(self, plan: Plan, path: ReferencePath) -> Plan:
        """Return a plan in the map in the states of the problem; multipliers are kept."""
        return plan

    def to_map(self, plan: Plan, path: ReferencePath) -> Plan:
        """Return a plan of the problem in the map."""
        return plan


@cache
def symbolic_ocp(
    kind: type[Formulation], name: str, circles: int, obstacles: int, rules: Rules
) -> SymbolicOcp:
    """Return a formulation in symbols for vehicle circles and obstacles of the given numbers."""
    template = kind.stage(
        car=rules.car,
        weights=cost_terms.weights(rules.terms),
        D_sft=SafetyDistance(*SafetyDistance._fields),
        body=VehicleCircles('radius', ('offset',) * circles, 'edge_radius'),
        envelope=cost_terms.limits(rules.terms),
        least_speed='least_speed',
        v_ref='v_ref',
        edges=rules.frame.edges,
        obstacles=(Disc(*Disc._fields),) * obstacles,
        **dict(kind.template),
    )
    return SymbolicOcp(
        name=name,
        state=kind.state,
        template=template,
        rates=kind.rates,
        terms=rules.terms,
        quantities=partial(kind.quantities, rules=rules),
        constraints=kind.constraints,
    )


def find(name: str) -> type[Formulation]:
    """Return the class of the formulation that a parameter file names."""
    return resolve_name(FORMULATIONS[name])


def make(params: ControllerParams, car: Car) -> Formulation:
    """Return the formulation that the parameters name.

    Raises ParameterError for an option that the formulation does not have.
    """
    options = params.formulation
    kind = find(options.name)
    # others measure along the path, and take the edges at every state
    in_map = kind.state is State
    if not in_map and (options.distance != 'path' or options.lag):
        raise ParameterError(
            'formulation: frenet measures along the path and has no lag error; '
            "allowed with it: distance 'path' and lag false"
        )
    if params.model.theta == INTEGRATED and not kind.integrates_theta:
        raise ParameterError(
            f'model.theta: the states or the reference of {options.name} begin where the car is '
            f'on the path; allowed with it: {PROJECTED}'
        )
    asked = {
        'safety.fit_edges': params.safety.fit_edges,
        'surroundings.align_track': params.surroundings.align_track,
    }
    for name, is_on in asked.items():
        if is_on and not in_map:
            raise ParameterError(
                f'{name}: is true, but {options.name} takes the edges of the road at every state; '
                'allowed with it: false'
            )
    return kind(params, car)
