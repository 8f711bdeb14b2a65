"""Upper bounds on any placement: tangents, cuts, concave and linear relaxations."""
