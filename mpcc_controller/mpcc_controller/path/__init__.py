"""The road as the controller sees it: paths, edges, and the distances to what must be avoided."""
