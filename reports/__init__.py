"""Studies, figures and pages made from solutions and simulations."""
