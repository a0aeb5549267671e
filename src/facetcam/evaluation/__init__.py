"""How good results are: errors of trajectories, and what detectors find again."""
