"""The paper's experiments 1 to 3: evolution alone, and evolution with a demonstration (paper, section IV)."""
