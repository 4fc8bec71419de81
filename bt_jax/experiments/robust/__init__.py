"""The experiment on faults: trees evolved without and with them, planned, and demonstrated, in the same episodes."""
