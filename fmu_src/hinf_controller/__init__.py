"""Sampled static state feedback as a component."""
