"""What the search learns, which leaf achieves what and in which order leaves work, and the offspring made of that."""
