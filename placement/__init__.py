"""Where roadside cameras go: candidates, information, objectives, solvers, certificates."""
