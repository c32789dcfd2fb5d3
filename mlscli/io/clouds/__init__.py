"""Files of points, reconstructions and trajectories."""
