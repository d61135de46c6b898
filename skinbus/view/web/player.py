"""A film played: where it stands, how fast it goes, step by step; the same to the page as a follower."""

from __future__ import annotations

from typing import Final

from skinbus.skin.cycle import Cycle
from skinbus.skin.film import Film
from skinbus.view.web.history import SPAN_S, History

SPEEDS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)


class FilmPlayer:
    """Plays a film; its time goes on by ``advance`` only."""

    silent_s = 0.0
    """A recording does not fall silent: what is shown is of the time that is shown."""

    def __init__(self, film: Film) -> None:
        self.film = film
        self.seconds = 0.0
        """Where it stands, s after the first cycle."""
        self.speed = 1.0
        self.is_playing = True
        self.history = History()
        self._shown = -1

    @property
    def error(self) -> Exception | None:
        """What has ended the making of the film, if that was an error."""
        return self.film.error

    @property
    def has_ended(self) -> bool:
        """Whether it stands at the end of a film that is complete."""
        return self.film.is_complete and self.number >= len(self.film) - 1

    @property
    def n_cycles(self) -> int:
        """Cycles there are so far."""
        return len(self.film)

    @property
    def number(self) -> int:
        """Number of the cycle where it stands."""
        return min(self.film.at(self.seconds), max(len(self.film) - 1, 0))

    @property
    def newest(self) -> Cycle | None:
        """The cycle where it stands; None while there is none."""
        if not len(self.film):
            return None
        number = self.number
        if number != self._shown:
            self._remember(number)
            self._shown = number
        return self.film[number]

    def advance(self, elapsed_s: float) -> None:
        """Let time go on, as far as the film is made."""
        if self.is_playing:
            self.seconds = min(self.seconds + self.speed * elapsed_s, self.film.seconds)
            if self.has_ended:
                self.is_playing = False

    def seek(self, seconds: float) -> None:
        """Go to a time."""
        self.seconds = min(max(seconds, 0.0), self.film.seconds)

    def step(self, n: int) -> None:
        """Stand still, and go on by cycles."""
        self.is_playing = False
        if len(self.film):
            self.seconds = self.film.seconds_of(min(max(self.number + n, 0), len(self.film) - 1))

    def play(self) -> None:
        """Go on, from the begin where it stands at the end."""
        if self.has_ended:
            self.seconds = 0.0
        self.is_playing = True

    def zero(self, patch: int | None) -> None:
        """Refuse."""
        self.film.zero(patch)

    def close(self) -> None:
        """End the film."""
        self.film.close()

    def _remember(self, number: int) -> None:
        """Bring the history to a cycle: on from where it was, or the last twenty seconds anew."""
        first = self._shown + 1
        if not 0 < first <= number:
            self.history = History()
            first = self.film.at(max(self.film.seconds_of(number) - SPAN_S, 0.0))
        for k in range(first, number + 1):
            self.history.take(self.film[k])
