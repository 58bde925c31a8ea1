"""A car as the controller's plant: high-fidelity double track at 1 kHz, and its ROS 2 node."""
