"""One demonstration from the first image to the last."""

from __future__ import annotations

import time
from collections.abc import Callable

from bt_jax.deploy.perception.camera import CameraError
from bt_jax.deploy.perception.film import FilmEnded
from bt_jax.teaching.watch.looking import Looking
from bt_jax.teaching.watch.moves import Watched
from bt_jax.teaching.watch.sighting import Sighting
from bt_jax.teaching.watch.watcher import Event, Watcher

__all__ = ["watch_demonstration"]

POLL = 0.005  # seconds between two looks for a newer image


def watch_demonstration(
    looking: Looking,
    watcher: Watcher,
    *,
    say: Callable[[Event], None] = lambda event: None,
    show: Callable[[Sighting], None] = lambda sighting: None,
    ended: Callable[[], bool] = lambda: False,
) -> Watched:
    """Watch until the film ends, the camera fails, `ended` says so, Ctrl-C is pressed, or nothing has moved for long enough.
    Whatever has been seen by then is returned; `say` gets what it tells, and `show` every image."""
    said: set[str] = set()
    try:
        while not (watcher.over or ended()):
            sighting = looking.look()
            if sighting is None:
                time.sleep(POLL)
                continue
            for event in watcher.update(sighting):
                say(event)
            for text in () if watcher.missing else looking.findings():
                if text not in said:  # what moves is not judged
                    said.add(text)
                    say(Event(sighting.time, "doubt", text))
            show(sighting)
    except (FilmEnded, KeyboardInterrupt):
        pass
    except CameraError as error:
        say(Event(watcher.time, "doubt", f"{error}; what was seen until then is kept"))
    events, watched = watcher.finish()
    for event in events:
        say(event)
    return watched
