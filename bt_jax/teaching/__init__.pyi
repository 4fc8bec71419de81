from bt_jax.teaching.script import Input, parse_script, perform, reached_by, record
from bt_jax.teaching.teleoperation import Landing, Teleoperation

__all__ = [
    "Input",
    "Landing",
    "Teleoperation",
    "parse_script",
    "perform",
    "reached_by",
    "record",
]
