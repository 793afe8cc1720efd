"""libcosim, the co-simulation library of the Open Simulation Platform, in C++; steps are in ns."""

from __future__ import annotations

from libcosimpy.CosimConstants import success
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
from toolchains.peer_run import PeerRun, Rows, label, serve


def run_tool(peer_run: PeerRun) -> Rows:
    """Its fixed-step algorithm: all step, then all variables are handed over."""
    if peer_run.again:
        raise NotImplementedError("libcosim has no call that resets an execution")
    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(peer_run.step_ns)
    slaves, index, references = [], {}, {}
    for name, part in peer_run.parts.items():
        slave = CosimLocalSlave(part.fmu, name)
        slaves.append(slave)  # the execution does not keep it
        index[name] = execution.add_local_slave(slave)
        references[name] = peer_run.references(name)
        for variable, value in part.parameters.items():
            initial = (
                execution.integer_initial_value
                if isinstance(value, int)
                else execution.real_initial_value
            )
            assert initial(index[name], references[name][variable], value)
    for a, output, b, name in peer_run.wires:
        connected = execution.connect_real_variables(
            index[a], references[a][output], index[b], references[b][name]
        )
        assert connected == success
    observer = CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    rows: dict[str, list[float]] = {label(*watched): [] for watched in peer_run.watch}
    for _ in range(peer_run.steps):
        assert execution.step(), execution.status()
        for part, variable in peer_run.watch:
            (value,) = observer.last_real_values(index[part], [references[part][variable]])
            rows[label(part, variable)].append(value)
    return rows


if __name__ == "__main__":
    serve(run_tool)
