"""FMPy reads the archive, its schema included, and simulates it.

Its simulator takes parameters as an argument, named element.variable, and starts every connected
input at zero: the outputs at the start reach no input.
"""

from __future__ import annotations

from typing import Any

from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import Parameter, ParameterSet, find_components, read_ssd
from toolchains.ssp_peer_run import Archive, Rows, label, serve


def run_tool(archive: Archive) -> Rows:
    """Its own loop."""
    bound: Any = ParameterSet(name="parameters")
    for component in find_components(read_ssd(archive.ssp).system):
        for binding in component.parameterBindings:
            for values in binding.parameterValues:
                bound.parameters += [
                    Parameter(name=f"{component.name}.{p.name}", type=p.type, value=p.value)
                    for p in values.parameters
                ]
    stop = (archive.steps - 0.5) * archive.step  # it adds its steps up
    result: Any = simulate_ssp(
        archive.ssp, stop_time=stop, step_size=archive.step, parameter_set=bound
    )
    return {label(*w): [float(x) for x in result[label(*w)]] for w in archive.watch}


if __name__ == "__main__":
    serve(run_tool)
