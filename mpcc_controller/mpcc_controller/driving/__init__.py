"""From state to command, every tick: receding horizon, fallbacks, gate. No ROS."""
