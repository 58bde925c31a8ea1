"""The prediction model: the car as the controller believes it to be."""
