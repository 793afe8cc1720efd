"""A sensor on a plain connection as a component: a scenario's [sensors.NAME]."""
