"""The car and its plan for RViz and Foxglove: markers, frames, a live server.

marker_scene     car, safety areas and plan as shapes, for markers and server alike
foxglove_server  topics, shapes and frames over a WebSocket
playback_server  a bag, controlled from Foxglove
"""
