"""Layouts for viewers of traces, made from the topics of one: Lichtblick and PlotJuggler."""

from cosim.trace.viewers.write import Viewer, WrittenLayout, write_layout

__all__ = ["Viewer", "WrittenLayout", "write_layout"]
