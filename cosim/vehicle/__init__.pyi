from .actuation import Actuation as Actuation
from .crossing import (
    crossing_lines as crossing_lines,
    crossing_title as crossing_title,
    crossings as crossings,
)
from .design_model import (
    as_designed_for as as_designed_for,
    flight_model as flight_model,
)
from .diagnosis import (
    Finding as Finding,
    diagnose as diagnose,
)
from .flight import (
    Flight as Flight,
    fly as fly,
    plant_note as plant_note,
)
from .flight_design import (
    DESIGN as DESIGN,
    certified_design as certified_design,
    estimated_states as estimated_states,
    known_delays as known_delays,
    made_before as made_before,
    measurements_of as measurements_of,
)
from .flight_plan import (
    LOSSES_IN_A_ROW as LOSSES_IN_A_ROW,
    FlightSettings as FlightSettings,
    planned_sensors as planned_sensors,
)
from .flight_scenario import (
    Mission as Mission,
    scenario_text as scenario_text,
)
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
)
from .read import (
    VEHICLES as VEHICLES,
    load_vehicle as load_vehicle,
    vehicle_from_toml as vehicle_from_toml,
    vehicle_text as vehicle_text,
)
from .template import vehicle_template as vehicle_template
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
from .vehicle_overview import (
    Overview as Overview,
    draw_overview as draw_overview,
    overview as overview,
)
