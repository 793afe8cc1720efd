"""Export FMUs: components, their variables and equations, packed for FMI 2.0 and 3.0."""
