"""How a run ended and how close it came: finish, collisions, road departure, loss of control.

Distances are those of the paper (eq. 3 and 4), between circles, and those of the true outline.
"""

from operator import itemgetter

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import SEARCH_M
from bags.evaluation.metrics.registry import EvaluatedDrive, metric

REACHED_M = 0.1  # how closely the stop has to be reached
SLIDING_DEG = 30.0  # sideslip that no controller here plans: twice that of the tyres' limit
SPUN_DEG = 90.0  # beyond it a car moves backwards
OUTLINE_STEP_S = 0.01  # between two poses at which the outline is checked
OUTLINE_SPACING_M = 0.6  # between two points of the outline
INSIDE = {'left': -1.0, 'right': 1.0}  # sign of the road's side of an edge
STANDING_MPS = 0.5  # below this speed a car stands
CIRCLE, OUTLINE = 'circle', 'outline'
TOO_SLOW = 'too_slow'  # reason of the controller, see docs/safety.md


@metric()
def verdict(run):
    """How the run ended, in words."""
    station, speed, finish = run.series.station, run.series.speed[-1], run.value(finish_at_m)
    beyond, ticks = np.flatnonzero(station >= finish), run.drive.ticks
    row = len(station) - 1  # of the odometry, when it ended
    if run.value(completed):
        row, end = -1, f'reached the finish line at {finish:.0f} m'  # said first
    elif station[0] >= finish:
        row, end = 0, 'started beyond the finish line'
    elif beyond.size:
        row, end = int(beyond[0]), f'passed the finish line beside the road at {finish:.0f} m'
    elif speed >= STANDING_MPS:
        end = f'did not reach the finish line: ended at {station[-1]:.0f} m with {speed:.1f} m/s'
    else:
        end, reason = f'stood still at {station[-1]:.0f} m', ticks.last_reason
        # a car that spun is slow for another reason than the controller's
        if reason and not (reason == TOO_SLOW and run.value(lost)):
            least = run.drive.facts.least_speed if reason == TOO_SLOW else None
            below = f': below {least:g} m/s it only brakes' if least else ''
            end += f' (reason of the controller: {reason}{below})'
    # in the order in which they happened: causes before what they led to
    events = sorted([*find_losses(run), (row, end)], key=itemgetter(0))
    parts = [text for _, text in events]
    if not run.value(collided):
        parts.append('no collision')
    if not ticks.answered_ns.size:
        parts.append('no command answered a state')
    return '; '.join(parts)


@metric('completed', good_when=True)
def completed(run):
    """Whether the car reached the finish line with its circles' centres between the road edges.

    A car that passes the finish line beside the road, or starts beyond it, has not completed.
    """
    finish, station = run.value(finish_at_m), run.series.station
    centres = np.min([*run.series.v2e.values()], axis=0) + run.drive.facts.vehicle_radius
    reached = np.any((station >= finish) & (centres > 0.0))
    return bool(reached and station[0] < finish)


@metric(unit='m')
def finish_at_m(run):
    """Station that completes the drive."""
    facts = run.drive.facts
    from_m = float(run.series.station[0]) + facts.armed_after
    return stop_station(run.drive.scene.reference, facts.stop, from_m)


@metric('collided', good_when=False, yes='yes, {collided_by}')
def collided(run):
    """Whether the outline or a circle of the car overlapped with an obstacle."""
    return run.value(collided_by) is not None


@metric()
def collided_by(run):
    """Return what touched: `outline`, or `circle` where only circles overlapped, or None."""
    outline, circle = run.value(min_outline_gap_m), run.value(min_v2o_m)
    if outline is not None and outline < 0.0:
        return OUTLINE
    return CIRCLE if circle is not None and circle < 0.0 else None


@metric('left the road', good_when=False)
def left_road(run):
    """Whether the true outline reached beyond an edge of the road."""
    return run.value(left_road_at_m) is not None


@metric('  at station', 'm', 1, optional=True)
def left_road_at_m(run):
    """Station at which the outline first reached beyond an edge; None on the road."""
    rows, beyond = run.value(outline_beyond_edge)
    outside = np.flatnonzero(beyond > 0.0)
    return float(run.series.station[rows[outside[0]]]) if outside.size else None


@metric('  outline beyond the edge', 'm', 2, optional=True)
def beyond_edge_m(run):
    """How far the farthest point of the outline ever was beyond an edge; None on the road."""
    _, beyond = run.value(outline_beyond_edge)
    return float(beyond.max()) if run.value(left_road) else None


@metric('lost control', good_when=False, yes='{lost_how}')
def lost(run):
    """Whether the sideslip angle exceeded 30 deg while the car moved."""
    return bool(np.any(_sideslip_deg(run) > SLIDING_DEG))


@metric()
def lost_how(run):
    """`spun` when the sideslip angle also exceeded 90 deg, else `sideslip`; None under control."""
    if not run.value(lost):
        return None
    return 'spun' if np.any(_sideslip_deg(run) > SPUN_DEG) else 'sideslip'


@metric('  at station', 'm', 1, optional=True)
def lost_at_m(run):
    """Station at which the sideslip angle first exceeded 30 deg; None under control."""
    beyond = np.flatnonzero(_sideslip_deg(run) > SLIDING_DEG)
    return float(run.series.station[beyond[0]]) if beyond.size else None


@metric('entered unsafe area', good_when=False)
def entered_unsafe_area(run):
    """Whether a distance fell below its safety distance, to an obstacle or to an edge."""
    facts, to_obstacle = run.drive.facts, run.value(min_v2o_m)
    near_obstacle = to_obstacle is not None and to_obstacle < facts.safe_obstacle
    return near_obstacle or run.value(min_v2e_m) < facts.safe_edge


@metric('outline entered unsafe area', good_when=False)
def outline_entered_unsafe_area(run):
    """Whether the true outline came nearer than the safety distance to an obstacle or an edge."""
    facts, gap = run.drive.facts, run.value(min_outline_gap_m)
    near_obstacle = gap is not None and gap < facts.safe_obstacle
    _, beyond = run.value(outline_beyond_edge)
    return bool(near_obstacle or beyond.max() > -facts.safe_edge)


@metric('min distance to obstacle', 'm', 2)
def min_v2o_m(run):
    """Smallest distance D_V2O between the circles of the car and an obstacle."""
    return _least(run.value(min_v2o_per_obstacle_m))


@metric('  obstacle {}', 'm', 2)
def min_v2o_per_obstacle_m(run):
    """Smallest distance D_V2O to each obstacle, by its id."""
    return {str(number): _smallest_finite(gap) for number, gap in run.series.v2o.items()}


@metric('min distance to road edge', 'm', 2)
def min_v2e_m(run):
    """Smallest distance D_V2E between the circles of the car and an edge of the road."""
    return min(run.value(min_v2e_per_edge_m).values())


@metric('  {}', 'm', 2)
def min_v2e_per_edge_m(run):
    """Smallest distance D_V2E to the left and to the right edge."""
    return {side: _smallest_finite(gap) for side, gap in run.series.v2e.items()}


@metric('min gap of the outline', 'm', 2)
def min_outline_gap_m(run):
    """Smallest gap between the true outline and an obstacle; negative: depth of the overlap."""
    return _least(run.value(min_outline_gap_per_obstacle_m))


@metric(unit='m')
def min_outline_gap_per_obstacle_m(run):
    """Smallest gap between the true outline and each obstacle, by its id."""
    return {str(number): _smallest_finite(gap) for number, gap in run.series.outline_gaps.items()}


@metric('min outline distance to edge', 'm', 2)
def min_outline_v2e_m(run):
    """Smallest distance of the true outline to an edge of the road; negative beyond it."""
    return min(run.value(min_outline_v2e_per_edge_m).values())


@metric(unit='m')
def min_outline_v2e_per_edge_m(run):
    """Smallest distance of the true outline to the left and to the right edge."""
    _, margins = run.value(_outline_margins)
    return {side: float(margin.min()) for side, margin in margins.items()}


def _least(gaps):
    return min((gap for gap in gaps.values() if gap is not None), default=None)


def _smallest_finite(values):
    """Return the smallest finite value of an array; None without any."""
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else None


def _sideslip_deg(run):
    """Return |sideslip| (n,) [deg]; not-a-number, of a car that hardly moves, exceeds nothing."""
    return np.degrees(np.abs(run.series.sideslip))


def stop_station(reference: np.ndarray, stop: tuple[float, float], from_m: float) -> float:
    """Return the station [m] that completes a run: that of the stop, less REACHED_M.

    The road may pass the stop more than once: the first pass beyond `from_m` counts. Where it does
    not pass the stop again, the earlier pass counts.
    """
    vertex, point = geometry.arc_length(reference), np.array([stop])
    first = int(np.searchsorted(vertex, from_m - REACHED_M)) - 1
    first = min(max(0, first), len(vertex) - 2)
    ahead = geometry.project_drive(point, reference[first:], SEARCH_M)
    anywhere = geometry.project_drive(point, reference, SEARCH_M)
    if abs(ahead.offset[0]) > abs(anywhere.offset[0]) + geometry.LAP_TOLERANCE:
        return float(anywhere.distance[0] - REACHED_M)
    return float(vertex[first] + ahead.distance[0] - REACHED_M)


def outline_beyond_edge(run: EvaluatedDrive) -> tuple[np.ndarray, np.ndarray]:
    """Return indices (n,) of odometry messages and how far [m] the outline is beyond an edge then.

    The farthest point counts: negative where the whole outline is inside, minus infinity where it
    is so far inside that its points were not checked.
    """
    rows, margins = run.value(_outline_margins)
    return rows, -np.min([*margins.values()], axis=0)


def _outline_margins(run):
    return edge_margins(run, geometry.outline_points(run.drive.facts.outline, OUTLINE_SPACING_M))


def edge_margins(run: EvaluatedDrive, body: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return indices (n,) of odometry messages and by side how far [m] points are from the edge.

    `body` (k, 2) is in the vehicle frame [m]. Of the point closest to the edge, negative beyond it;
    infinity where the centre is so far away that its distance is neither below the safety distance
    nor the least of the drive.
    """
    motion, t = run.drive.motion, run.series.t
    sampled = np.searchsorted(t, np.arange(t[0], t[-1], OUTLINE_STEP_S))
    rows = np.unique(np.append(sampled, len(t) - 1))
    # from the centre of gravity to the farthest point
    reach = np.hypot(*body.T).max()
    centre = np.column_stack([motion.x[rows], motion.y[rows]])
    margins = {}
    for side, edge in (('left', run.drive.scene.left), ('right', run.drive.scene.right)):
        away = INSIDE[side] * geometry.offset_from_line(centre, edge)
        # no point is farther from the edge than the centre at its closest
        near = np.flatnonzero(away <= reach + max(run.drive.facts.safe_edge, away.min()))
        k = rows[near]
        points = geometry.transform_to_map(body, motion.x[k], motion.y[k], motion.yaw[k])
        inside = INSIDE[side] * geometry.offset_from_line(points.reshape(-1, 2), edge)
        margins[side] = np.full(len(rows), np.inf)
        margins[side][near] = inside.reshape(len(near), -1).min(axis=1)
    return rows, margins


def find_losses(run: EvaluatedDrive) -> list[tuple[int, str]]:
    """Return where the car slid, left the road and collided, in the order in which it happened.

    Of each the row of the odometry when it began, and what happened, for a person.
    """
    events = []
    if run.value(lost):
        at, sideslip = run.value(lost_at_m), _sideslip_deg(run)
        text = f'slid at {at:.0f} m (sideslip angle up to {np.nanmax(sideslip):.0f} deg)'
        text = f'spun at {at:.0f} m' if run.value(lost_how) == 'spun' else text
        events.append((int(np.argmax(sideslip > SLIDING_DEG)), text))
    if run.value(left_road):
        rows, beyond = run.value(outline_beyond_edge)
        at, farthest = run.value(left_road_at_m), run.value(beyond_edge_m)
        text = f'left the road at {at:.0f} m, by up to {farthest:.2f} m'
        events.append((int(rows[np.argmax(beyond > 0.0)]), text))
    # circles may overlap although the outline passes
    for number, gaps in run.series.outline_gaps.items():
        outline, circle = _smallest_finite(gaps), _smallest_finite(run.series.v2o[number])
        touching, how = gaps < 0.0, ''
        if outline is not None and outline < 0.0:
            how = f'outline, overlap {-outline:.2f} m'
        elif circle is not None and circle < 0.0:
            how = f'circle, overlap {-circle:.2f} m; outline passed by {outline:.2f} m'
            touching = run.series.v2o[number] < 0.0
        if how:
            text = f'collided with obstacle {number} ({how})'
            events.append((int(np.argmax(touching)), text))
    return sorted(events)
