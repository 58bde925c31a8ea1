"""MCAP files in the rosbag2 layout: written, read into columns, described, repaired."""
