"""The controls with which a film is played on the page."""

from __future__ import annotations

from typing import Any, Final

import viser

from skinbus.view.web import panels
from skinbus.view.web.player import SPEEDS, FilmPlayer

LEAST_S: Final = 0.01
"""Step of the slider, s."""


class Playback:
    """Slider, speed, steps and marks of a player in a viser server."""

    def __init__(self, server: viser.ViserServer, player: FilmPlayer) -> None:
        self._player = player
        gui = server.gui
        self._slider: Any = gui.add_slider("Time, s", 0.0, LEAST_S, LEAST_S, 0.0)
        self._play = gui.add_button_group("Play", ("Play", "Pause", "-1", "+1"))
        names = tuple(f"{speed:g} x" for speed in SPEEDS)
        self._speed = gui.add_dropdown("Speed", names, initial_value="1 x")
        self._text = gui.add_html("")
        self._slider.on_update(self._seek)
        self._play.on_click(self._press)
        self._speed.on_update(lambda _: self._set_speed(SPEEDS[names.index(self._speed.value)]))

    def show(self) -> None:
        """Show where the player stands."""
        film = self._player.film
        length = max(round(film.seconds, 2), LEAST_S)
        if self._slider.max != length:
            self._slider.max = length
        self._slider.value = min(round(self._player.seconds, 2), length)
        self._text.content = panels.playing(self._player.number + 1, len(film), film.is_complete, film.marks)

    def _seek(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # a person has moved it, not the time
            self._player.seek(self._slider.value)

    def _set_speed(self, speed: float) -> None:
        self._player.speed = speed

    def _press(self, _: Any) -> None:
        word = self._play.value
        if word == "Play":
            self._player.play()
        elif word == "Pause":
            self._player.is_playing = False
        else:
            self._player.step(int(word))
