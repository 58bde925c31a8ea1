"""The contract between the nodes: topics, shared types, conversion, checks."""
