"""Named faults: what they do to a design, and that a machine shows them."""

import pytest

from hpv_twin.model import Simulation, Vibrator, VibratorError, find_cycles
from hpv_twin.model.faults import FAULTS, apply_faults


def settled(design):
    """Figures of the last cycle."""
    cycles = find_cycles(Simulation(design).advance(0.4))
    return {name: float(getattr(cycles, name)[-1])
            for name in ('frequency', 'opening_pressure', 'return_pressure', 'dwell',
                         'lowest_pressure', 'build_up', 'forward', 'stroke')}


def test_healthy_is_the_design_itself():
    assert apply_faults(Vibrator(), dict.fromkeys(FAULTS, 0.0)) == Vibrator()
    assert apply_faults(Vibrator(), {}) == Vibrator()


@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_changes_its_own_field_in_proportion_to_its_severity(name):
    fault, base = FAULTS[name], Vibrator()
    half, full = (getattr(apply_faults(base, {name: s}), fault.field) for s in (0.5, 1.0))
    healthy = getattr(base, fault.field)
    assert half - healthy == pytest.approx((full - healthy) / 2.0) != 0.0
    assert apply_faults(base, {name: 1.0}).replace(**{fault.field: healthy}) == base


@pytest.mark.parametrize(('name', 'figure', 'sign'), [
    ('air_in_oil', 'frequency', -1), ('pump_leakage', 'frequency', -1),
    ('preload_loss', 'opening_pressure', -1), ('worn_slot', 'dwell', -1),
    ('sticking_plunger', 'forward', 1), ('blocked_drain', 'return_pressure', 1)])
def test_a_machine_shows_its_fault_and_still_strokes_fully(name, figure, sign):
    base = Vibrator()
    healthy = settled(base)
    for severity in (0.2, 1.0):
        faulty = settled(apply_faults(base, {name: severity}))
        assert sign * (faulty[figure] - healthy[figure]) > 0.01 * severity * healthy[figure]
        assert faulty['stroke'] == pytest.approx(base.stroke, rel=1e-12)


def test_all_at_once_they_add_up():
    every = apply_faults(Vibrator(), dict.fromkeys(FAULTS, 0.3))
    for fault in FAULTS.values():
        alone = apply_faults(Vibrator(), {fault.name: 0.3})
        assert getattr(every, fault.field) == getattr(alone, fault.field)


@pytest.mark.parametrize(('faults', 'reason'), [
    ({'air': 0.3}, 'no fault "air"; there are: air_in_oil'),
    ({'worn_slot': 1.1}, r'worn_slot = 1.1 is outside \[0, 1\]'),
    ({'worn_slot': float('nan')}, 'is outside')])
def test_what_cannot_be_is_refused_with_its_reason(faults, reason):
    with pytest.raises(VibratorError, match=reason):
        apply_faults(Vibrator(), faults)
