"""Reading films, folders, cameras and tables; writing trajectories, point clouds and run folders."""
