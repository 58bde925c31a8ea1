"""Model predictive contouring control at the limit of handling."""
