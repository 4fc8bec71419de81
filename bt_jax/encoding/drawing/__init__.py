"""Trees drawn in the terminal and as SVG."""
