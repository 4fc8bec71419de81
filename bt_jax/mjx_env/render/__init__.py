"""Pictures and films of episodes."""
