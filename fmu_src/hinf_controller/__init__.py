"""Static state feedback, sampled, as a component."""
