"""The map as a function of the points: the stages, and where they are evaluated."""
