from .table import series_of as series_of
from .traffic import link_names as link_names
