"""Path, road and distances; numbers and CasADi expressions.

reference_path    the coarse path as arcs: checks, projection, evaluation
arc               an arc of the path; contouring and lag error; sin, cos, sqrt of anything
road_edges        road edges as tangent parabolas; centre and width of the road
distance          distances D_V2O and D_V2E
compiled_queries  the queries of path and road edges in C
frenet_frame      path coordinates, and distances in them
"""
