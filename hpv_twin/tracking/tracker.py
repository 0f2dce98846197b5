"""
Tracking: windows in, estimates out; sudden changes are attributed by comparing hypotheses.

While nothing surprising happens one filter runs. When a window does not fit, several run side by
side: nothing changed, one parameter changed (which?), everything changed. Each is judged by the
evidence of the windows that follow, and what cannot be told apart is averaged, with the spread
between the candidates in the covariance.
"""
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hpv_twin.model import Vibrator

from .estimator import ESTIMATES, SIZE, Estimate, Filter, NoCycleError
from .waveform import Deviation
from .windows import Window, WindowFinder

SURPRISE = 8.0  # standard deviations of a window's squared innovation that call for hypotheses
POINTED = 5.0  # the same for the innovations of the last windows along one sensitivity
KEPT = 0.96  # of that sum, from window to window
ACQUIRING = 0.35  # s of good windows before estimates are trusted
DECIDED = 12.0  # by so much log evidence the best hypothesis leads when the others are dropped
LEAST_WINDOWS, LONGEST_TRIAL = 4, 0.7  # s
NOISE_AT_FIRST = 0.02  # of the pressure's range
NOISE_FLOOR = 2e-4  # of the range
NOISE_MEMORY = 0.7  # s
SETPOINT_STEP = 3e-3  # a relative change above this makes the windows around it unusable
SETPOINT_DELAY = 0.03  # s until the machine has obeyed, beside one cycle
MISFIT = 0.08  # a residual above this share of the range is not this model's motion
MISFIT_TIME = 1.5  # s
NOTHING, EVERYTHING = 'nothing', 'everything'
HYPOTHESES = {NOTHING: (), **{name: (index,) for index, name in enumerate(ESTIMATES)},
              EVERYTHING: tuple(range(SIZE))}


class Trial:
    """Hypotheses about a sudden change, each a filter with the evidence for it."""

    def __init__(self, before: Filter, began: float):
        self.began = began
        self.filters = {name: before.widen(which) for name, which in HYPOTHESES.items()}
        self.evidence = dict.fromkeys(HYPOTHESES, 0.0)
        self.updates = {}
        self.windows = 0

    def feed(self, window: Window, design, noise: float) -> None:
        """Let every hypothesis meet a window; those without a cycle or without a chance go."""
        worst = {}
        for name, filter_ in list(self.filters.items()):
            try:
                ready = filter_.predict(window) if self.windows else filter_.locate(window, design)
                self.filters[name], update = ready.update(window, design, noise,
                                                          search=not self.windows)
            except (NoCycleError, np.linalg.LinAlgError):
                self._drop(name)
                continue
            self.updates[name] = update
            worst[name] = update.cost / update.count
            self.evidence[name] += update.evidence
        self.windows += 1
        if worst:
            # A model that is somewhat wrong must not decide by its own confidence.
            tempered = max(1.0, min(worst.values()))
            best = max(self.evidence.values())
            for name in [name for name, evidence in self.evidence.items()
                         if (best - evidence) / tempered > 2.0 * DECIDED]:
                self._drop(name)

    def _drop(self, name):
        for kept in (self.filters, self.evidence, self.updates):
            kept.pop(name, None)

    @property
    def best(self) -> str:
        """The hypothesis with most evidence."""
        return max(self.evidence, key=self.evidence.get)

    @property
    def lead(self) -> float:
        """Log evidence by which the best leads the next."""
        ranked = sorted(self.evidence.values())
        return ranked[-1] - ranked[-2] if len(ranked) > 1 else math.inf

    def shares(self) -> dict[str, float]:
        """Probability of each hypothesis, equal before any evidence."""
        best = self.evidence[self.best]
        weight = {name: math.exp(max(-700.0, value - best))
                  for name, value in self.evidence.items()}
        total = sum(weight.values())
        return {name: value / total for name, value in weight.items()}

    def average(self) -> Filter:
        """One filter for all that is still possible, the spread between them included."""
        best = self.filters[self.best]
        shares = {name: share for name, share in self.shares().items() if share > 1e-3}
        total = sum(shares.values())
        x = sum(share * self.filters[name].x for name, share in shares.items()) / total
        covariance = np.zeros_like(best.covariance)
        for name, share in shares.items():
            filter_ = self.filters[name]
            away = np.append(filter_.x - x, filter_.opening - best.opening)
            if abs(away[-1]) > 0.5 * best.period:
                away[-1] = 0.0
            covariance += share / total * (filter_.covariance + np.outer(away, away))
        return replace(best, x=x, covariance=covariance)


class Tracker:
    """
    Follows a machine by its measured pressure.

    `reference` is the design the machine is compared with. `feed` takes samples in order of time
    (s, any origin; Pa gauge) and returns an Estimate for each window that could be used;
    `command` tells of setpoints. One thread uses it.
    """

    def __init__(self, reference: Vibrator):
        self.coordinates = Deviation(reference)
        self._design = reference
        self._finder = WindowFinder(0.04 * max(reference.opening_pressure, 1e6))
        self._changed = -math.inf  # when the setpoints last moved by much
        self.skipped = 0
        self.changes: list[tuple[float, dict[str, float]]] = []
        self.forget()

    def forget(self) -> None:
        """Begin anew, as with a machine never seen before."""
        self._filter = Filter.at_first(self.coordinates)
        self._finder.reset()
        self._trial = None
        self._trusted_from = math.nan
        self._misfit_since = math.nan
        self._noise = math.nan
        self._window_end = math.nan
        self._look_anew()
        self.last: Estimate | None = None

    def _look_anew(self):
        self._score, self._spread = np.zeros(SIZE), np.zeros(SIZE)

    def _pointed(self, update) -> bool:
        """Whether small surprises have added up along one parameter."""
        self._score = KEPT * self._score + update.score
        self._spread = KEPT ** 2 * self._spread + update.spread
        return bool(np.any(np.abs(self._score) > POINTED * np.sqrt(self._spread)))

    def interrupt(self) -> None:
        """The samples have a gap: parameters are kept, the phase is not."""
        self._finder.reset()
        self._filter = replace(self._filter, opening=math.nan)
        self._trial = None

    @property
    def trusted(self) -> bool:
        """Whether the last estimate may be acted on."""
        return self.last is not None and self.last.time >= self._trusted_from + ACQUIRING

    @property
    def misfit(self) -> bool:
        """Whether the machine has not moved like the model for some time."""
        return (self.last is not None
                and self.last.time - self._misfit_since > MISFIT_TIME)

    @property
    def candidates(self) -> dict[str, float]:
        """While a change is being judged: what may have changed, with probabilities."""
        return self._trial.shares() if self._trial is not None and self._trial.updates else {}

    @property
    def last_fall(self) -> float | None:
        """When the measured pressure last fell from its peak, s."""
        return self._finder.last_fall

    @property
    def design(self) -> Vibrator:
        """The reference with the setpoints in force."""
        return self._design

    def command(self, time: float, **setpoints: float) -> None:
        """Tell of setpoints (pump_flow, preload, load) in force from `time` on."""
        before, self._design = self._design, self._design.replace(**setpoints)
        if change(before, self._design) > SETPOINT_STEP:
            self._changed = time

    def feed(self, times, pressures) -> list[Estimate]:
        """Take samples; return what the windows they complete say."""
        estimates = []
        for window in self._finder.feed(times, pressures):
            if window.start < self._changed + SETPOINT_DELAY + window.period:
                self.skipped += 1
                self._filter = replace(self._filter, opening=math.nan)
                self._trial = None
                continue
            try:
                estimate = self._take(window)
            except (NoCycleError, np.linalg.LinAlgError):
                estimate = None
            if estimate is None:
                self.skipped += 1
                continue
            estimates.append(estimate)
            self.last = estimate
        return estimates

    def _take(self, window) -> Estimate | None:
        if math.isnan(self._noise):
            self._noise = NOISE_AT_FIRST * window.range
        if self._trial is not None:
            return self._judge(window)
        located = not math.isnan(self._filter.opening)
        prior = (self._filter.predict(window) if located
                 else self._filter.locate(window, self._design))
        after, update = prior.update(window, self._design, self._noise, search=not located)
        acquiring = not window.start >= self._trusted_from + ACQUIRING
        if acquiring or not located:
            self._look_anew()
        elif self._pointed(update) or update.surprise > SURPRISE:
            self._look_anew()
            self._trial = Trial(prior, window.end)
            return None
        self._filter = after
        return self._finish(window, update)

    def _judge(self, window):
        """Give a window to the hypotheses; settle on the outcome when it is plain or time is up."""
        trial = self._trial
        trial.feed(window, self._design, self._noise)
        if not trial.updates:
            self._trial = None
            self._filter = Filter.at_first(self.coordinates)
            self._trusted_from = math.nan
            return None
        self._filter, update = trial.average(), trial.updates[trial.best]
        lasted = window.end - trial.began
        if lasted > LONGEST_TRIAL or (trial.windows >= LEAST_WINDOWS and trial.lead > DECIDED):
            self.changes = [*self.changes[-19:], (trial.began, trial.shares())]
            self._trial = None
        return self._finish(window, update, learn=self._trial is None)

    def _finish(self, window, update, learn=True):
        good = update.residual < MISFIT * window.range
        if math.isnan(self._trusted_from) and good:
            self._trusted_from = window.start
        if good:
            self._misfit_since = math.nan
        elif math.isnan(self._misfit_since):
            self._misfit_since = window.start
        if learn:
            self._learn_noise(window, update)
        self._window_end = window.end
        return self._filter.estimate(window, self._design, update, self._noise)

    def _learn_noise(self, window, update):
        """Follow the residual's size, slowly: it is the measure of every uncertainty."""
        share = min(0.3, (window.end - window.start) / NOISE_MEMORY)
        # A surprising window teaches little, or noise would excuse every change.
        seen = min(update.residual ** 2, 9.0 * self._noise ** 2)
        self._noise = max(math.sqrt((1.0 - share) * self._noise ** 2 + share * seen),
                          NOISE_FLOOR * window.range)


def change(before: Vibrator, after: Vibrator) -> float:
    """Return the largest relative change between the setpoints of two designs."""
    flow = abs(after.pump_flow - before.pump_flow) / max(before.pump_flow, 1e-9)
    force = abs(after.slotted_spring_stiffness * (after.preload - before.preload)
                + after.load - before.load)
    return max(flow, force / max(abs(after.slotted_spring_stiffness * after.preload), 1.0))
