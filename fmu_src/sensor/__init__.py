"""A sensor as a component: sampled values with noise and the time at which they were taken."""
