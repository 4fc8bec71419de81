"""What the page knows and does, without a widget: tasks, evolutions, demonstrations, playback."""
