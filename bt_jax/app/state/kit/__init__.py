"""A kit that a person builds: objects, trays and slots are changed, and everything that names them follows."""
