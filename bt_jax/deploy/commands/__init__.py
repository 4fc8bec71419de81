"""The commands of python -m bt_jax.deploy: arguments in, a call to the rooms below, text out."""
