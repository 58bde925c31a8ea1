"""Today's controller, made from the notes of a run and told what the recorded one was told."""

import json
import warnings
from collections.abc import Mapping
from typing import Any

from bags.errors import BagError, OlderRunWarning
from experiments.replay import feed
from experiments.replay.feed import Told
from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.tick import TickInputs, unknown_state
from mpcc_controller.parameters import CarActuators, CarParams, ControllerParams
from msgs_yaml import conversions, share
from msgs_yaml.strict_yaml import closest
from msgs_yaml.types import Command, Prediction, Why
from node_runtime import node_parameters, parameters

ROLE = 'controller'
ACTUATORS, LAYOUT, CAR_FILE = 'actuators', 'model.drive_front_share', 'car_file'
FORMULATION, DEFAULT = 'formulation.name', 'mpcc'  # and the file of its defaults


class Again:
    """One controller on the ticks of a recording."""

    def __init__(self, params: ControllerParams, vehicle: CarParams):
        self.controller, self.vehicle = Controller(params, vehicle), vehicle
        self._told: Told | None = None

    def answer(self, told: Told, stamp_ns: int) -> tuple[Command, Prediction, Why]:
        """Return command, plan and reasons for what was told at one tick.

        The time limits of realtime are not in force; the delay is predicted for as long as the
        recorded controller predicted it.
        """
        if told.actuators is not None:
            self.controller.reset(told.actuators)
        self._tell(told)
        state = told.state if told.state is not None else unknown_state(stamp_ns)
        inputs = TickInputs(state, fault=told.fault, effective_ns=told.acts_ns)
        record = self.controller.step(inputs)
        plan, why = self.controller.report(record)
        return record.command, conversions.prediction_as_received(plan), why

    def follow(self, command: Command) -> None:
        """Go on from a recorded command, which the car has been told, not from the last answer."""
        self.controller.set_last_command(command)
        self.controller.prepare()

    def _tell(self, told):
        before, self._told = self._told, told
        if before is None or not feed.same(told.reference, before.reference):
            self.controller.set_reference(told.reference)
        if before is None or not feed.same(told.edges, before.edges):
            self.controller.set_edges(told.edges)
        self.controller.set_obstacles(told.obstacles)


def of_notes(run_info: Mapping[str, str], settings: Mapping[str, Any], name: str) -> Again:
    """Return the controller of a run; `settings` change its parameters by dotted name.

    `name` is what errors call the run. Raises BagError for notes that do not hold the parameters
    that today's controller has, and for a setting that does not exist or is out of range.
    """
    return Again(*params(run_info, settings, name))


def params(
    run_info: Mapping[str, str], settings: Mapping[str, Any], name: str
) -> tuple[ControllerParams, CarParams]:
    """Return the parameters of a recorded controller, changed by `settings`; see `of_notes`.

    A `car_file` in the settings replaces the car of the run by the one in that file; settings of
    single parameters of the car win over it. A parameter that did not exist yet when the run was
    made takes today's default, with an OlderRunWarning that names it.
    """
    try:
        noted = json.loads(run_info['parameters'])[ROLE]
    except (KeyError, ValueError):
        raise BagError(
            f'{name}: the run does not say the parameters of its controller; was it recorded by '
            'hand?'
        ) from None

    def source(key):
        return '--set' if key in settings else f'{name}: parameters of the controller'

    older = _actuators(noted)
    # the car says the layout, unless it is set: what an older run noted must not hide another car
    unused = {*node_parameters.COMMON, *([LAYOUT] if older else [])}
    given = {key: value for key, value in noted.items() if key not in unused}
    given = _defaults(noted, name) | older | given | _other_car(settings) | settings
    classes = (ControllerParams, CarParams)
    known = [parameters.leaves(cls) for cls in classes]
    try:
        made = [
            parameters.build_from(cls, {k: v for k, v in given.items() if k in own}, source)
            for cls, own in zip(classes, known)
        ]
        _refuse_unknown(given, known, source)
        car_file.check_limits(*made, dict.fromkeys(settings, '--set'))
    except parameters.ParameterError as error:
        raise BagError(str(error)) from None
    return tuple(made)


def _other_car(settings):
    """Return the parameters in the car file that is set, none where none is."""
    name = settings.get(CAR_FILE)
    if not isinstance(name, str):
        return {}  # what is no text is refused with the other parameters
    try:
        return parameters.flatten(car_file.read(name))
    except (parameters.ParameterError, OSError) as error:
        raise BagError(f'--set {CAR_FILE}={name}: {error}') from None


def _refuse_unknown(given, known, source):
    names = [name for own in known for name in own]
    for key in given:
        if key not in names:
            hint = closest(key, names)
            raise parameters.ParameterError(
                f'{source(key)}: {key}: the controller has no such parameter{hint}'
            )


def _actuators(noted):
    """Return the car's actuators where the notes are older than these parameters.

    The controller knew the drive layout under another name, and its limits were not cut.
    """
    leaves = parameters.leaves(CarActuators)
    if f'{ACTUATORS}.drive_front_share' in noted or LAYOUT not in noted:
        return {}
    unbounded = {f'{ACTUATORS}.{name}': leaves[name].rule.high for name in car_file.SHARED_LIMITS}
    return {f'{ACTUATORS}.drive_front_share': noted[LAYOUT], **unbounded}


def _defaults(noted, name):
    """Return what the notes of an older run do not say, as it is set today."""
    path = share.path('mpcc_controller', 'config', f'{noted.get(FORMULATION, DEFAULT)}.yaml')
    today = parameters.read_file(path).values
    unsaid = {key: value for key, value in today.items() if key not in noted}
    if unsaid:
        told = ', '.join(f'{key} = {value}' for key, value in unsaid.items())
        warnings.warn(
            f'{name}: the run does not say all parameters of its controller, which is newer; '
            f'assumed: {told}',
            OlderRunWarning,
            stacklevel=2,
        )
    return unsaid
