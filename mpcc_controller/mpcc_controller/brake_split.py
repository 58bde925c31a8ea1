"""The front share of the braking force: an input of the problem, or a constant of the car."""

import dataclasses

from mpcc_controller.parameters import FIXED, ControllerParams
from node_runtime.parameters import ParameterError

# Brown & Gerdes, "Coordinating tire forces to avoid obstacles using nonlinear model predictive
# control", IEEE T-IV 2019, and its predecessors fix 0.6 to 0.7
FRONT_SHARE = 0.65


def with_fixed_split(params: ControllerParams) -> ControllerParams:
    """Return the parameters with both limits of the split at the share of a fixed one.

    Raises ParameterError for a share without a fixed split.
    """
    share = params.formulation.brake_front_share
    if params.formulation.brake_split != FIXED:
        if share is not None:
            raise ParameterError(
                f'formulation.brake_front_share: is {share:g}, but formulation.brake_split is '
                f'free; allowed with {FIXED}'
            )
        return params
    share = FRONT_SHARE if share is None else share
    limits = dataclasses.replace(
        params.limits, brake_front_share_min=share, brake_front_share_max=share
    )
    return dataclasses.replace(params, limits=limits)
