from .table import series_of as series_of
