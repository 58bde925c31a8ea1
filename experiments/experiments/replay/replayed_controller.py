"""Today's controller with the parameters of a recorded run, on the inputs of its ticks."""

import json
import warnings
from collections.abc import Collection, Mapping
from typing import Any

from bags.errors import BagError, OlderRunWarning
from experiments.replay.recorded_ticks import RecordedInputs, has_same_content
from mpcc_controller import car_file, run_time_parameters
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, unknown_state
from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml import conversions, share
from msgs_yaml.strict_yaml import closest
from msgs_yaml.types import Command, Prediction, StopPlan, Why
from node_runtime import node_parameters, parameters

ROLE = 'controller'
CAR_FILE = 'car_file'
FORMULATION, DEFAULT = 'formulation.name', 'mpcc'  # and the file of its defaults


class ReplayedController:
    """One controller on the ticks of a recording."""

    def __init__(
        self, params: ControllerParams, vehicle: CarParams, kept: Collection[str] = frozenset()
    ):
        """`kept` names parameters that keep their values, whatever the run has changed."""
        self.controller, self.vehicle = Controller(params, vehicle), vehicle
        self._params, self._kept, self._changes = params, kept, {}
        self._inputs: RecordedInputs | None = None

    def step(
        self, inputs: RecordedInputs, stamp_ns: int
    ) -> tuple[Command, Prediction, Why, StopPlan | None]:
        """Return command, plan, report and stop plan, None without one, for the inputs of one tick.

        Time limits of realtime are not in force; the delay is predicted for as long as the recorded
        controller predicted it.
        """
        before, self._inputs = self._inputs, inputs
        self._change(inputs.changes)
        if inputs.actuators is not None:
            self.controller.reset(inputs.actuators, inputs.resumed)
        if before is None or not has_same_content(inputs.reference, before.reference):
            self.controller.set_reference(inputs.reference)
        if before is None or not has_same_content(inputs.edges, before.edges):
            self.controller.set_edges(inputs.edges)
        self.controller.set_obstacles(inputs.obstacles)
        self.controller.set_predictions(inputs.predictions)
        state = inputs.state if inputs.state is not None else unknown_state(stamp_ns)
        given = TickInputs(state, effective_ns=inputs.acts_ns, actuators=inputs.compared)
        record = self.controller.step(given._replace(fault=inputs.fault))
        stop = self.controller.stop_plan(record)
        stop = stop if stop is None else conversions.stop_plan_as_received(stop)
        plan, why = self.controller.report(record)
        return record.command, conversions.prediction_as_received(plan), why, stop

    def _change(self, changes: Mapping[str, float]) -> None:
        """Drive by the parameters that were in force at a tick.

        A controller that was started again reports no earlier changes: it has the values of the
        start. BagError for changes that today's controller refuses.
        """
        if changes == self._changes:
            return
        self._changes = dict(changes)
        try:
            followed = {k: v for k, v in changes.items() if k not in self._kept}
            params = run_time_parameters.change(self._params, followed)
        except parameters.ParameterError as error:
            raise BagError(f'the run changed a parameter while it drove: {error}') from None
        self.controller.change(params, followed)

    def continue_from(self, command: Command) -> None:
        """Continue from a recorded command, which the car received, instead of the last answer."""
        self.controller.set_last_command(command)
        self.controller.prepare()


def from_run_info(
    run_info: Mapping[str, str], settings: Mapping[str, Any], name: str
) -> ReplayedController:
    """Return the controller of a run; `settings` change its parameters by dotted name.

    `name` is that of the run in errors. Raises BagError for run information without the parameters
    of a controller, and for a setting that does not exist or is out of range.
    """
    return ReplayedController(*recorded_params(run_info, settings, name), frozenset(settings))


def recorded_params(
    run_info: Mapping[str, str], settings: Mapping[str, Any], name: str
) -> tuple[ControllerParams, CarParams]:
    """Return the parameters of a recorded controller, changed by `settings`; see `from_run_info`.

    A `car_file` in the settings replaces the car of the run; settings of single parameters of the
    car override it. A parameter that is newer than the run takes today's default, one that is gone
    since is left out, both with an OlderRunWarning that names it.
    """
    try:
        recorded = json.loads(run_info['parameters'])[ROLE]
    except (KeyError, ValueError):
        raise BagError(
            f'{name}: the run does not say the parameters of its controller; was it recorded by '
            'hand?'
        ) from None

    def source(key):
        return '--set' if key in settings else f'{name}: parameters of the controller'

    classes = (ControllerParams, CarParams)
    known = [parameters.leaves(cls) for cls in classes]
    given = {k: value for k, value in recorded.items() if k not in node_parameters.MANAGED}
    gone = {key: given.pop(key) for key in [*given] if not any(key in own for own in known)}
    _warn_of(name, 'has parameters of its controller that are gone; left out', gone)
    file = share.path('mpcc_controller', 'config', f'{recorded.get(FORMULATION, DEFAULT)}.yaml')
    today = parameters.read_file(file).values
    newer = {key: value for key, value in today.items() if key not in recorded}
    _warn_of(name, 'does not say all parameters of its controller, which is newer; assumed', newer)
    given = newer | given | _other_car(settings) | settings
    params, vehicle = [
        parameters.build(cls, {k: v for k, v in given.items() if k in own}, source)
        for cls, own in zip(classes, known)
    ]
    names = [name for own in known for name in own]
    for key in given:
        if key not in names:
            hint = closest(key, names)
            raise BagError(f'{source(key)}: {key}: the controller has no such parameter{hint}')
    car_file.check_limits(params, vehicle, dict.fromkeys(settings, '--set'))
    return params, vehicle


def _other_car(settings):
    """Return the parameters of the car file in the settings, {} without one."""
    name = settings.get(CAR_FILE)
    if not isinstance(name, str):
        return {}  # a value that is no text is refused with the other parameters
    try:
        return parameters.flatten(car_file.read(name))
    except (parameters.ParameterError, OSError) as error:
        raise BagError(f'--set {CAR_FILE}={name}: {error}') from None


def _warn_of(name, what, values):
    if values:
        listed = ', '.join(f'{key} = {value}' for key, value in values.items())
        warnings.warn(f'{name}: the run {what}: {listed}', OlderRunWarning, stacklevel=3)
