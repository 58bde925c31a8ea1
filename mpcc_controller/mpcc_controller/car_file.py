"""Where the numbers of the car come from."""

from pathlib import Path

from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml import parameters, share


def load(params: ControllerParams) -> CarParams:
    """Read the file that the controller's parameters name: one of config/, or any path.

    Raises ParameterError for a wrong value, FileNotFoundError for a file that is nowhere.
    """
    named = Path(params.car_file)
    in_config = named.parent == Path()
    path = share.path('mpcc_controller', 'config', named.name) if in_config else named
    return parameters.load(CarParams, path)
