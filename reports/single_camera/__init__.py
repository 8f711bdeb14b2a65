"""One camera beside a bend: pitch, yaw and both fields of view chosen together, with a proof."""
