"""Where a fit begins: closed-form estimates from period, peak pressure and pace of the build-up."""
from __future__ import annotations

import math

import numpy as np

from hpv_twin.model import Vibrator
from hpv_twin.model.designs import FIELDS

from .cycle_wave import CycleWave, cycle_wave
from .folding import Fold
from .measured import Measured


def first_guesses(start: Vibrator, names: tuple[str, ...], measured: Measured,
                  fold: Fold) -> list[np.ndarray]:
    """
    Return starts by closed forms: preload by the peak pressure, stiffness times flow by the period.

    The build-up tells only their product, so the split is tried in several ways.
    """
    opening = opening_pressure_of(measured, fold)
    design = start
    area = start.plunger_seat_area
    force = area * (opening - start.opening_pressure)
    guess = dict.fromkeys(names, 0.0)
    if 'preload' in names:
        wanted = start.preload + force / start.slotted_spring_stiffness
        if wanted > 0.05 * start.preload:
            guess['preload'] = math.log(wanted / start.preload)
            design = design.replace(preload=min(wanted, FIELDS['preload'].metadata['high']))
    guesses = []
    for split in (0.0, 0.12, -0.12, 0.25, -0.25):
        trial, own = dict(guess), design
        for _ in range(12):
            # By period and pace: the cycle of the model is made as long as the machine's.
            wave = cycle_wave(own)
            if wave is None:
                break
            ratio = wave.period / fold.period
            if abs(ratio - 1.0) < 3e-3:
                break
            factor = math.exp(max(-0.5, min(0.5, 1.15 * math.log(ratio))))
            trial, own = moved(trial, start, names, own, factor)
        if split:
            trial, own = split_again(trial, start, names, own, split)
        wave = cycle_wave(own)
        phase = 0.0 if wave is None else fall_phase(wave, fold.level)
        guesses.append(np.array([*trial.values(), phase]))
    return guesses


def moved(trial: dict, start: Vibrator, names, own: Vibrator, factor: float):
    """Speed the machine up by `factor`: by its stiffness where that is free, else by its flow."""
    name = 'bulk_modulus' if 'bulk_modulus' in names else 'pump_flow'
    if name not in names:
        return trial, own
    value = getattr(own, name) * factor
    return {**trial, name: math.log(value / getattr(start, name))}, own.replace(**{name: value})


def split_again(trial: dict, start: Vibrator, names, own: Vibrator, split: float):
    """Give more to the flow and as much less to the stiffness."""
    if not {'bulk_modulus', 'pump_flow'} <= set(names):
        return trial, own
    own = own.replace(pump_flow=own.pump_flow * math.exp(split),
                      bulk_modulus=own.bulk_modulus * math.exp(-split))
    return {**trial, 'pump_flow': math.log(own.pump_flow / start.pump_flow),
            'bulk_modulus': math.log(own.bulk_modulus / start.bulk_modulus)}, own


def opening_pressure_of(measured: Measured, fold: Fold) -> float:
    """Estimate the pressure, Pa gauge, where the plunger lifts: the peak less a little."""
    return 0.97 * float(np.percentile(measured.pressure, 99.0))


def fall_phase(wave: CycleWave, level: float) -> float:
    """Phase at which the model's pressure falls through `level`, counted from the opening."""
    peak = int(np.argmax(wave.pressure))
    below = np.flatnonzero(wave.pressure[peak:] < level)
    return float(wave.since[peak + below[0]] / wave.period) if len(below) else 0.3
