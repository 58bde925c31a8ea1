"""Which equations of motion move a plant: our double track, or the multi-body model."""

from vehicle_plant import integrator
from vehicle_plant.car import MultiBodyParams, PlantParams
from vehicle_plant.integrator import Model


def model_of(params: PlantParams) -> Model:
    """Return the model that the parameters are for."""
    if isinstance(params, MultiBodyParams):
        # needs a package that a plant of its own does not
        from vehicle_plant.multi_body.equations import MULTI_BODY

        return MULTI_BODY
    return integrator.DOUBLE_TRACK
