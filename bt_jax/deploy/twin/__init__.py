"""The simulated cell: a controller with physics and a network, a rendered camera, a person who interferes."""
