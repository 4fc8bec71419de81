"""How well learning from demonstrations works: synthetic demonstrations with known intentions, and their assessment."""
