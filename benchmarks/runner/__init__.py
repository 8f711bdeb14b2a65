"""`placement benchmark`: solvers × instances × seeds, every row checked again by the referee."""
