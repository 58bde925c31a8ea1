"""Where the numbers of the car come from."""

from collections.abc import Mapping

from mpcc_controller.parameters import CarParams, ControllerParams
from node_runtime import node_parameters, parameters
from node_runtime.node_parameters import NO_SOURCES


def load(params: ControllerParams, sources: Mapping[str, str] = NO_SOURCES) -> CarParams:
    """Read the file that `car_file` names; see `read`."""
    return read(params.car_file, sources)


def read(name: str, sources: Mapping[str, str] = NO_SOURCES) -> CarParams:
    """Read a car; see `node_parameters.find_config` for names and paths.

    Raises ParameterError for a wrong value and for a file that does not exist; `sources` says by
    parameter where its name comes from.
    """
    path = node_parameters.find_named_config(
        'mpcc_controller', 'car_file', name, 'car.mass_kg', sources
    )
    return parameters.load(CarParams, path)
