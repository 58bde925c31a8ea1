"""What decides a run: scenario, controller, parameters of every node; checked before it starts."""
