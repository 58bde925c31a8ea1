"""Circles that cover the outline of the car, in place of those that the parameter file lists."""

import dataclasses

import numpy as np

from mpcc_controller.parameters import Body, CarOutline, CarParams, ControllerParams
from node_runtime.parameters import ParameterError


def cover(outline: CarOutline, count: int) -> tuple[float, tuple[float, ...]]:
    """Return the radius [m] and the offsets [m ahead of the CoG] of circles over an outline.

    Each circle covers an equal share of the length: its radius is half the diagonal of a rectangle
    as long as the share and as wide as the car.
    """
    half_share = (outline.front_m + outline.rear_m) / (2 * count)
    offsets = -outline.rear_m + half_share * (2 * np.arange(count) + 1)
    return float(np.hypot(half_share, outline.width_m / 2)), tuple(offsets.tolist())


def with_covering_circles(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with the circles that `body.circles` asks for, if it does.

    Beside a centre the car is as wide as it is: at an edge, which is almost parallel to the car,
    half of the width counts. The radius would take away 0.3 m of road on either side.

    Raises ParameterError for a car file without the outline.
    """
    if params.body.circles is None:
        return params
    missing = [name for name, value in dataclasses.asdict(vehicle.outline).items() if value is None]
    if missing:
        raise ParameterError(
            f'body.circles: is {params.body.circles}, but car_file {params.car_file} does not have '
            f'outline.{missing[0]}; allowed with a file of `identify` that has the outline'
        )
    radius, offsets = cover(vehicle.outline, params.body.circles)
    at_edges = params.body.edge_radius_m
    if at_edges is None:
        at_edges = vehicle.outline.width_m / 2
    body = Body(radius, offsets, params.body.circles, at_edges)
    return dataclasses.replace(params, body=body)
