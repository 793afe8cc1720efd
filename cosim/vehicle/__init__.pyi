from .keys import (
    VehicleKey as VehicleKey,
    vehicle_tables as vehicle_tables,
)
from .parameters import Parameter as Parameter
from .read import (
    VEHICLES as VEHICLES,
    load_vehicle as load_vehicle,
    vehicle_from_toml as vehicle_from_toml,
    vehicle_text as vehicle_text,
)
from .vehicle import (
    Actuator as Actuator,
    Control as Control,
    OnboardDamping as OnboardDamping,
    Sensor as Sensor,
    Vehicle as Vehicle,
)
