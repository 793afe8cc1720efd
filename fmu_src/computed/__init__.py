"""Values computed from signals as a component: a scenario's [computed.NAME]."""
