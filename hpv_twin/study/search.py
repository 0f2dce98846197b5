"""The search for a front: NSGA-II over all of it, then its ends by themselves."""
from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from tqdm import tqdm

from hpv_twin.model import Vibrator

from .front import Front
from .problem import DesignProblem

KEEPING = 5.0  # s between two times that the front is kept
SHARPENING = 0.15  # share of the evaluations that goes to the ends of the front


def search(base: Vibrator, goals, farm, population: int, evaluations: int,
           seed: int, keep: Callable[[Front, int], None] | None = None) -> tuple[Front, int]:
    """
    Let NSGA-II try most of so many designs, and sharpen the ends of the front with the rest.

    Returns the front, in order, and how many were tried. A Ctrl-C ends it early. `keep` is given
    both now and then on the way, so that less is lost when the process is killed.
    """
    problem, front, done = DesignProblem(base, goals, farm), Front(), 0
    due = time.monotonic() + KEEPING
    with contextlib.suppress(KeyboardInterrupt), \
            tqdm(total=evaluations, unit=' designs', smoothing=0.1, file=sys.stderr,
                 disable=None) as bar:
        for tried in generations(problem, front, population, evaluations, seed):
            done += tried
            bar.update(tried)
            bar.set_postfix_str(f'{len(front)} on the front', refresh=False)
            if keep and len(front) and time.monotonic() > due:
                keep(front.sorted(), done)
                due = time.monotonic() + KEEPING
    return front.sorted(), done


def generations(problem, front: Front, population: int, evaluations: int,
                seed: int) -> Iterator[int]:
    """Let the front take in one generation after the other; yields how many designs each tried."""
    random = np.random.default_rng(seed)
    broad = round((1.0 - SHARPENING) * evaluations)
    algorithm = NSGA2(pop_size=population, sampling=first_designs(problem, population, random))
    algorithm.setup(problem, termination=('n_eval', broad), seed=seed, verbose=False)
    done = 0
    while done < broad:
        tried = algorithm.ask()
        algorithm.evaluator.eval(problem, tried)
        front.take_in(problem.latest, tried.get('F'), tried.get('G'))
        algorithm.tell(infills=tried)
        done += len(tried)
        yield len(tried)
    turn = 0
    while done < evaluations:
        count = min(population, evaluations - done)
        x = near_an_end(problem, front, turn, count, random)
        out: dict = {}
        problem._evaluate(x, out)
        front.take_in(problem.latest, out['F'], out['G'])
        turn, done = turn + 1, done + count
        yield count


def first_designs(problem, count: int, random) -> np.ndarray:
    """Corners of the bounds as far as they go into half of `count`, the rest at random."""
    x = random.uniform(problem.xl, problem.xu, (count, problem.n_var))
    corners = np.array(list(product((0.0, 1.0), repeat=min(problem.n_var, 10))))
    corners = corners[random.permutation(len(corners))[:count // 2]]
    if corners.shape[1] == problem.n_var:
        x[:len(corners)] = problem.xl + corners * (problem.xu - problem.xl)
    return x


def near_an_end(problem, front: Front, turn: int, count: int, random) -> np.ndarray:
    """Designs about the front's best in one objective after the other, ever nearer to it."""
    if not len(front):
        return random.uniform(problem.xl, problem.xu, (count, problem.n_var))
    best = int(np.argmin(front.objectives[:, turn % problem.n_obj]))
    centre = np.array([front.columns[name][best] for name in problem.names])
    width = 0.2 * 0.7 ** (turn // problem.n_obj) * (problem.xu - problem.xl)
    # Some fields move, the others stay: an end often lies on a bound.
    moved = random.random((count, problem.n_var)) < 0.5
    return np.clip(centre + moved * width * random.normal(size=(count, problem.n_var)),
                   problem.xl, problem.xu)
