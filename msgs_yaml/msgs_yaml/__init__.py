"""The contract between the nodes: topics, types, conversion, and the ROS glue that obeys it."""
