"""Numbers and texts of a scenario file: their ranges and units."""

from typing import Annotated

from node_runtime import parameters
from node_runtime.parameters import Range
from scenario_publisher.build import Pattern

# coordinates and speeds as wide as topics.yaml lets them through
Coordinate = Annotated[float, Range(-10000.0, 10000.0, 'm')]
Station = Annotated[float, Range(0.0, 10000.0, 'm')]
Length = Annotated[float, Range(0.5, 10000.0, 'm')]
Offset = Annotated[float, Range(-100.0, 100.0, 'm')]
Yaw = Annotated[float, Range(-6.3, 6.3, 'rad')]
# 5 m is the tightest circle a passenger car can turn
Curvature = Annotated[float, Range(-0.2, 0.2, '1/m')]
Speed = Annotated[float, parameters.SPEED]
Velocity = Annotated[float, Range(-50.0, 50.0, 'm/s')]
Radius = Annotated[float, Range(0.01, 50.0, 'm')]
Time = Annotated[float, Range(0.0, 600.0, 's')]
Spacing = Annotated[float, Range(0.1, 5.0, 'm')]
Friction = Annotated[float, parameters.ROAD_FRICTION]
Name = Annotated[str, Pattern('[a-z][a-z0-9_]{0,63}', '1 to 64 of a-z, 0-9, _, the first a letter')]
Text = Annotated[str, Pattern(r'(?s).{1,1000}', '1 to 1000 characters')]
