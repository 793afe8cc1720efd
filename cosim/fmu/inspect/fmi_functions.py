"""The functions that a binary must export, from the headers of the FMI standards."""

from __future__ import annotations

from typing import NamedTuple


class Functions(NamedTuple):
    """Names to export: the `core` that every run needs, and the others of the standard."""

    core: frozenset[str]
    others: frozenset[str]


def _names(prefix: str, text: str) -> frozenset[str]:
    return frozenset(prefix + name for name in text.split())


_STATUS = (
    "SetRealInputDerivatives GetRealOutputDerivatives CancelStep GetStatus GetRealStatus "
    "GetIntegerStatus GetBooleanStatus GetStringStatus"
)
_FMI1_COMMON = (
    "GetReal SetReal",
    "GetVersion SetDebugLogging GetInteger GetBoolean GetString SetInteger SetBoolean SetString",
)
_FMI1 = {
    "model exchange": (
        (
            "InstantiateModel FreeModelInstance SetTime SetContinuousStates Initialize Terminate "
            "CompletedIntegratorStep GetDerivatives EventUpdate GetContinuousStates"
        ),
        (
            "GetModelTypesPlatform GetEventIndicators GetNominalContinuousStates "
            "GetStateValueReferences"
        ),
    ),
    "co-simulation": (
        "InstantiateSlave InitializeSlave TerminateSlave FreeSlaveInstance DoStep",
        f"GetTypesPlatform ResetSlave {_STATUS}",
    ),
}
_FMI2_COMMON = (
    (
        "Instantiate FreeInstance SetupExperiment EnterInitializationMode ExitInitializationMode "
        "Terminate Reset GetReal GetInteger GetBoolean GetString SetReal SetInteger SetBoolean "
        "SetString"
    ),
    (
        "GetTypesPlatform GetVersion SetDebugLogging GetFMUstate SetFMUstate FreeFMUstate "
        "SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate GetDirectionalDerivative"
    ),
)
_FMI2 = {
    "model exchange": (
        (
            "EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep "
            "SetTime SetContinuousStates GetDerivatives GetEventIndicators GetContinuousStates "
            "GetNominalsOfContinuousStates"
        ),
        "",
    ),
    "co-simulation": ("DoStep", _STATUS),
}
_FMI3_TYPES = (
    "Float32 Float64 Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Boolean String Binary Clock"
)
_FMI3_COMMON = (
    "FreeInstance EnterInitializationMode ExitInitializationMode Terminate Reset",
    "GetVersion SetDebugLogging EnterEventMode GetNumberOfVariableDependencies "
    "GetVariableDependencies GetFMUState SetFMUState FreeFMUState SerializedFMUStateSize "
    "SerializeFMUState DeserializeFMUState GetDirectionalDerivative GetAdjointDerivative "
    "EnterConfigurationMode ExitConfigurationMode GetIntervalDecimal GetIntervalFraction "
    "GetShiftDecimal GetShiftFraction SetIntervalDecimal SetIntervalFraction SetShiftDecimal "
    "SetShiftFraction EvaluateDiscreteStates UpdateDiscreteStates "
    + " ".join(f"Get{kind} Set{kind}" for kind in _FMI3_TYPES.split()),
)
_FMI3 = {
    "model exchange": (
        (
            "InstantiateModelExchange EnterContinuousTimeMode CompletedIntegratorStep SetTime "
            "SetContinuousStates GetContinuousStateDerivatives GetContinuousStates "
            "GetNumberOfContinuousStates GetNumberOfEventIndicators"
        ),
        "GetEventIndicators GetNominalsOfContinuousStates",
    ),
    "co-simulation": ("InstantiateCoSimulation DoStep", "EnterStepMode GetOutputDerivatives"),
    "scheduled execution": ("InstantiateScheduledExecution ActivateModelPartition", ""),
}


def functions(major: int, kind: str, identifier: str) -> Functions:
    """Return what a binary must export in this version of FMI for this kind of use."""
    prefix = f"{identifier}_fmi" if major == 1 else f"fmi{major}"
    common, own = {
        1: (_FMI1_COMMON, _FMI1),
        2: (_FMI2_COMMON, _FMI2),
        3: (_FMI3_COMMON, _FMI3),
    }[major]
    core, others = own[kind]
    return Functions(_names(prefix, f"{common[0]} {core}"), _names(prefix, f"{common[1]} {others}"))
