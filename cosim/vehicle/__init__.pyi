from .actuation import Actuation as Actuation
from .keys import (
    VehicleKey as VehicleKey,
    vehicle_schema as vehicle_schema,
    vehicle_tables as vehicle_tables,
)
from .linearisation import (
    LinearModel as LinearModel,
    linear_model as linear_model,
)
from .parameters import Parameter as Parameter
from .plant import (
    VehicleFmu as VehicleFmu,
    export_vehicle as export_vehicle,
    named_vehicle as named_vehicle,
    plant_spec as plant_spec,
)
from .read import (
    VEHICLES as VEHICLES,
    load_vehicle as load_vehicle,
    vehicle_from_toml as vehicle_from_toml,
    vehicle_text as vehicle_text,
)
from .trim import (
    Trim as Trim,
    find_trim as find_trim,
)
from .vehicle import (
    Actuator as Actuator,
    Control as Control,
    OnboardDamping as OnboardDamping,
    Sensor as Sensor,
    Vehicle as Vehicle,
)
