"""How far long work is, on the terminal."""
from __future__ import annotations

import sys
import time


class Progress:
    """A bar on the terminal while long work goes on; what is short passes in silence."""

    WIDTH = 30  # characters

    def __init__(self, what: str):
        self._what = what
        self._next = time.monotonic() + 0.5
        self._shown = False

    def __call__(self, done: float, whole: float) -> None:
        """Show that `done` of `whole` is done."""
        if sys.stderr.isatty() and time.monotonic() >= self._next:
            self._next, self._shown = time.monotonic() + 0.2, True
            share = min(done / max(whole, 1), 1.0)
            bar = '#' * round(share * self.WIDTH)
            print(f'\r{self._what}  [{bar:.<{self.WIDTH}}] {100 * share:3.0f} %\033[K', end='',
                  file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear the line."""
        if self._shown:
            print('\r\033[K', end='', file=sys.stderr, flush=True)


class Status:
    """A line on the terminal that is written anew now and then; in silence elsewhere."""

    def __init__(self):
        self._next = 0.0

    def __call__(self, text: str) -> None:
        """Show `text`, at most every half second."""
        if sys.stderr.isatty() and time.monotonic() >= self._next:
            self._next = time.monotonic() + 0.5
            print(f'\r{text}\033[K', end='', file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear the line."""
        if self._next:
            print('\r\033[K', end='', file=sys.stderr, flush=True)
