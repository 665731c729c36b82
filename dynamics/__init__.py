"""How things move: parameters in, poses out, the same bytes every time. Needs numpy and Taichi only."""
