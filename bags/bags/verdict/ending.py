"""How a run ended, in one line for a person."""

import numpy as np

STANDING_MPS = 0.5  # below this speed a car stands
CIRCLE, OUTLINE = 'circle', 'outline'
TOO_SLOW = 'too_slow'  # reason of the controller, see docs/safety.md


def text(drive, s, found):
    """Return how a run ended; `found` are its other metrics, `s` is its Series."""
    parts = [_end(drive, s, found), *_lost(found), *_road(found), *_collisions(found, s)]
    if not drive.ticks.answered_ns.size:
        parts.append('no command answered a state')
    return '; '.join(parts)


def _end(drive, s, found):
    if found['completed']:
        return f'reached the finish line at {found["finish_at_m"]:.0f} m'
    if s.station[0] >= found['finish_at_m']:
        return 'started beyond the finish line'
    if s.station.max() >= found['finish_at_m']:
        return f'passed the finish line beside the road at {found["finish_at_m"]:.0f} m'
    station, speed = s.station[-1], s.speed[-1]
    if speed < STANDING_MPS:
        return f'stood still at {station:.0f} m{_reason(drive)}'
    return f'did not reach the finish line: ended at {station:.0f} m with {speed:.1f} m/s'


def _reason(drive):
    reason, least = drive.ticks.last_reason, drive.facts.least_speed
    if not reason:
        return ''
    below = f': below {least:g} m/s it only brakes' if reason == TOO_SLOW and least else ''
    return f' (reason of the controller: {reason}{below})'


def _lost(found):
    if found['lost_how'] == 'spun':
        yield f'spun at {found["lost_at_m"]:.0f} m'
    elif found['lost']:
        peak = found['peak_sideslip_deg']
        yield f'slid at {found["lost_at_m"]:.0f} m (sideslip angle up to {peak:.0f} deg)'


def _road(found):
    if found['left_road']:
        where, far = found['left_road_at_m'], found['beyond_edge_m']
        yield f'left the road at {where:.0f} m, by up to {far:.2f} m'


def _collisions(found, s):
    """Yield what was hit; circles may overlap though the outline passes."""
    if not found['collided']:
        yield 'no collision'
    for number, gap in s.outline_gaps.items():
        outline, circle = _smallest(gap), found['min_v2o_per_obstacle_m'][str(number)]
        if outline is not None and outline < 0.0:
            yield f'collided with obstacle {number} (outline, overlap {-outline:.2f} m)'
        elif circle is not None and circle < 0.0:
            overlap = f'circle, overlap {-circle:.2f} m; outline passed by {outline:.2f} m'
            yield f'collided with obstacle {number} ({overlap})'


def _smallest(values):
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else None
