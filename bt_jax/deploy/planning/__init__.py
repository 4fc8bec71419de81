"""Where an arm can go and how: inverse kinematics, clearance, grasps, paths, trajectories."""
