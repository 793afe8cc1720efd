"""Layouts for viewers of traces, made from the topics of one: Lichtblick and PlotJuggler."""

from cosim.trace.viewers.write_layout import Viewer, WrittenLayout, write_layout

__all__ = ["Viewer", "WrittenLayout", "write_layout"]
