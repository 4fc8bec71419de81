"""What README and documents claim, measured: python -m benchmarks.NAME."""
