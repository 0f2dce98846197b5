"""The Pareto front of an optimisation: every design met that no other one beats, and its points."""
from __future__ import annotations

import numpy as np

from hpv_twin.model import VibratorError

from .goals import OBJECTIVES


class Front:
    """
    Designs that keep all constraints and that none of them beats in all objectives.

    Nothing found is lost again, whatever the search goes on with: `columns` holds a row per
    design, `objectives`, shape (n, objectives), what was minimised.
    """

    def __init__(self):
        self.columns: dict[str, np.ndarray] = {}
        self.objectives = np.empty((0, 0))

    def __len__(self):
        return len(self.objectives)

    def take_in(self, columns: dict, objectives: np.ndarray, constraints: np.ndarray) -> None:
        """Let the front take in the designs of one evaluation."""
        kept = (constraints <= 0.0).all(axis=1)
        kept[kept] = ~beaten(objectives[kept], objectives[kept])
        if not kept.any():
            return
        columns = {name: values[kept] for name, values in columns.items()}
        objectives = objectives[kept]
        if not len(self):
            self.columns, self.objectives = columns, objectives
            return
        new = ~beaten(objectives, self.objectives, ties=True)
        old = ~beaten(self.objectives, objectives[new])
        self.objectives = np.concatenate([self.objectives[old], objectives[new]])
        self.columns = {name: np.concatenate([values[old], columns[name][new]])
                        for name, values in self.columns.items()}

    def sorted(self) -> Front:
        """Return the front in ascending order of the first objective, then of the others."""
        front = Front()
        if not len(self):
            return front
        order = np.lexsort(self.objectives.T[::-1])
        front.objectives = self.objectives[order]
        front.columns = {name: values[order] for name, values in self.columns.items()}
        return front


def beaten(points: np.ndarray, by: np.ndarray, ties: bool = False) -> np.ndarray:
    """
    Which of the `points`, (n, objectives), are dominated by one of `by`, shape (n,).

    With `ties` a point equal to one of `by` counts too.
    """
    result = np.zeros(len(points), dtype=bool)
    for start in range(0, len(points), 256):
        part = points[start:start + 256, None]
        no_worse = (by[None] <= part).all(axis=2)
        if not ties:
            no_worse &= (by[None] < part).any(axis=2)
        result[start:start + 256] = no_worse.any(axis=1)
    return result


def choose(objectives: np.ndarray, names: tuple[str, ...], wish: str) -> int:
    """
    Return the place of a point of the front: of its number (from 1), `knee` or `best:OBJECTIVE`.

    The knee is the point nearest to the best of every objective, each measured by its span.
    """
    if wish == 'knee':
        low, span = objectives.min(axis=0), np.ptp(objectives, axis=0)
        return int(np.argmin(np.linalg.norm((objectives - low) / np.where(span, span, 1.0),
                                            axis=1)))
    if wish.startswith('best:'):
        name = wish.removeprefix('best:')
        if name not in names:
            raise VibratorError(f'--choose {wish}: the objectives are {", ".join(names)}')
        return int(np.argmin(objectives[:, names.index(name)]))
    try:
        number = int(wish)
    except ValueError:
        raise VibratorError(f'--choose {wish}: expected a number, "knee" or "best:OBJECTIVE" '
                            f'({", ".join(names)})') from None
    if not 1 <= number <= len(objectives):
        raise VibratorError(f'--choose {number}: the front has points 1 to {len(objectives)}')
    return number - 1


def minimised(columns: dict, names: tuple[str, ...]) -> np.ndarray:
    """Return the objectives of rows as they are minimised, shape (n, objectives)."""
    return np.stack([-columns[OBJECTIVES[name][0]] if OBJECTIVES[name][1]
                     else columns[OBJECTIVES[name][0]] for name in names], axis=1)
