"""The browser page: teach, evolve, watch and correct, without programming. `python -m bt_jax.app` serves it."""
