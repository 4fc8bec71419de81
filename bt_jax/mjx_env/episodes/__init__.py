"""Trees executed from layout to ending: evaluation of populations, playback of one episode, fitness."""
