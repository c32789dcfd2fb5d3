"""The map as a function of the points: the stages, evaluated where they are asked for."""
