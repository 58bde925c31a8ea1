"""Markers to road edges and obstacles. `decode` offers these functions as its own."""

from typing import Any

import numpy as np

from msgs_yaml import stamp
from msgs_yaml.checked import DecodeError, check
from msgs_yaml.types import Obstacle, Obstacles, RoadEdges

# visualization_msgs/Marker
_ARROW, _CYLINDER, _LINE_STRIP = 0, 3, 4
_ADD, _DELETEALL = 0, 3
_EDGES = '/scenario/road_edges'
_OBSTACLES = '/scenario/obstacles'


def road_edges(msg: Any) -> RoadEdges:
    """Return the edges of /scenario/road_edges."""
    check(_EDGES, msg)
    lines = {}
    for marker in msg.markers:
        _expect(_EDGES, marker, {'left': _LINE_STRIP, 'right': _LINE_STRIP})
        lines[marker.ns] = np.array([(float(p.x), float(p.y)) for p in marker.points])
    if len(lines) != 2:
        raise DecodeError(f'{_EDGES}: markers are both {msg.markers[0].ns!r}; allowed left, right')
    return RoadEdges(_stamp_ns(_EDGES, msg.markers), lines['left'], lines['right'])


def obstacles(msg: Any) -> Obstacles:
    """Return the obstacles of /scenario/obstacles, in the order of their cylinders."""
    check(_OBSTACLES, msg)
    added = [marker for marker in msg.markers if marker.action != _DELETEALL]
    for marker in added:
        _expect(_OBSTACLES, marker, {'obstacle': _CYLINDER, 'velocity': _ARROW})
    cylinders = _by_id([marker for marker in added if marker.ns == 'obstacle'])
    arrows = _by_id([marker for marker in added if marker.ns == 'velocity'])
    if arrows.keys() - cylinders.keys():
        lost = min(arrows.keys() - cylinders.keys())
        raise DecodeError(f'{_OBSTACLES}: velocity {lost} belongs to no obstacle; allowed same id')
    items = tuple(_obstacle(c, arrows.get(number)) for number, c in cylinders.items())
    return Obstacles(_stamp_ns(_OBSTACLES, msg.markers), items)


def _obstacle(cylinder, arrow):
    diameter = float(cylinder.scale.x)
    if diameter != cylinder.scale.y:
        raise DecodeError(
            f'{_OBSTACLES}: scale.y of obstacle {cylinder.id} is {cylinder.scale.y}; '
            f'allowed scale.x = {diameter}, obstacles are round'
        )
    vX = vY = 0.0
    if arrow is not None:
        tail, tip = arrow.points
        vX, vY = float(tip.x) - float(tail.x), float(tip.y) - float(tail.y)
    position = cylinder.pose.position
    X, Y = float(position.x), float(position.y)
    return Obstacle(int(cylinder.id), X, Y, 0.5 * diameter, vX, vY)


def _expect(topic, marker, kinds):
    """Check namespace, type and action of a marker."""
    if marker.ns not in kinds:
        raise DecodeError(f'{topic}: ns is {marker.ns!r}; allowed {", ".join(kinds)}')
    if marker.type != kinds[marker.ns]:
        allowed = f'{kinds[marker.ns]} with ns {marker.ns}'
        raise DecodeError(f'{topic}: type is {marker.type}; allowed {allowed}')
    if marker.action != _ADD:
        raise DecodeError(f'{topic}: action is {marker.action}; allowed {_ADD} (ADD)')


def _by_id(markers):
    found = {int(marker.id): marker for marker in markers}
    if len(found) != len(markers):
        raise DecodeError(f'{_OBSTACLES}: two markers of one ns have one id; allowed different ids')
    return found


def _stamp_ns(topic, markers):
    stamps = {stamp.to_ns(marker.header.stamp) for marker in markers}
    if len(stamps) != 1:
        raise DecodeError(f'{topic}: markers have {len(stamps)} stamps; allowed one for all')
    return stamps.pop()
