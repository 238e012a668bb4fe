"""Where poses come from: grids over joint values or places, random designs, trajectories."""
