"""The obstacles that a plan is made for: measured with errors, expected to move, remembered.

/scenario/obstacles holds every known obstacle. What is not in it is unknown from then on, whether
it went away or was only missed. So what vanishes is kept for
`surroundings.memory_s` after it was last seen, wherever it was then, and forgotten after that;
an obstacle that is gone is avoided for that time at most. Which of them a problem has room for:
`stage_parameters.closest_obstacles`. SI units.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from mpcc_controller.driving import measurement_errors
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import road_following
from mpcc_controller.problem.obstacle_motion import AnyObstacle, Speeds, expected, moved, observed
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Obstacles, VehicleState


class Sighting(NamedTuple):
    """An obstacle as it was last seen."""

    stamp_ns: int
    obstacle: AnyObstacle


class Sightings(NamedTuple):
    """What is known of obstacles from tick to tick."""

    true_state: VehicleState  # of the car, from which it sees them
    speeds: Speeds = MappingProxyType({})
    last: Mapping[int, Sighting] = MappingProxyType({})  # by id, those of `surroundings.memory_s`


def observe(
    known: Sightings, scene: Scene, true_state: VehicleState, seen_ns: int, params: ControllerParams
) -> Sightings:
    """Return what is known after the obstacles of the last message were seen at an instant.

    What was last seen too long ago is forgotten, or after that (in a loop).
    """
    known = known._replace(true_state=true_state)
    if scene.obstacles is None:
        return known
    measured = _measured(known, scene.obstacles, seen_ns, params)
    speeds = observed(known.speeds, measured, params.surroundings.braking_window_s)
    known = known._replace(speeds=speeds)
    memory_s = params.surroundings.memory_s
    if not memory_s:
        return known
    seen = _expected(known, scene, seen_ns, params)
    last = known.last | {o.id: Sighting(seen.stamp_ns, o) for o in seen.items}
    return known._replace(
        last={
            key: sighting
            for key, sighting in last.items()
            if 0.0 <= ns_to_s(seen.stamp_ns - sighting.stamp_ns) <= memory_s
        }
    )


def scene_known(known: Sightings, scene: Scene, seen_ns: int, params: ControllerParams) -> Scene:
    """Return the scene with the obstacles of the last message as seen at an instant.

    Behind them are those that are remembered, moved to the same stamp.
    """
    if scene.obstacles is None:
        return scene
    seen = _expected(known, scene, seen_ns, params)
    present = {o.id for o in seen.items}
    missed = tuple(
        moved(last.obstacle, ns_to_s(seen.stamp_ns - last.stamp_ns))
        for key, last in known.last.items()
        if key not in present
    )
    return scene._replace(obstacles=seen._replace(items=seen.items + missed) if missed else seen)


def _expected(known, scene, seen_ns, params) -> Obstacles:
    """Return the obstacles of a message as seen at an instant, and how they go on."""
    seen = expected(_measured(known, scene.obstacles, seen_ns, params), known.speeds)
    if scene.path is None or scene.road is None:
        return seen
    return road_following.along_road(seen, scene.path, scene.road, params.surroundings)


def _measured(known, obstacles, seen_ns, params) -> Obstacles:
    errors = params.measurement_errors
    return measurement_errors.measured_obstacles(obstacles, known.true_state, seen_ns, errors)
