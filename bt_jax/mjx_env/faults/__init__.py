"""What goes wrong in episodes: fates drawn from keys, variants of commands, and what happens between two ticks."""
