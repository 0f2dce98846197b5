"""A design by the geometry of its slotted spring, (4) and (21)."""
import re
from pathlib import Path

import numpy as np
import pytest

from hpv_twin.model import Simulation, Vibrator, VibratorError, kernel
from hpv_twin.model.slotted_spring import SlottedSpring

PAGE = Path(__file__).parents[2] / 'docs' / 'model.md'
GEOMETRY = {'jumper_edge': 3.6e-3, 'rings': 14, 'mean_radius': 0.022}
SPRING = 'jumper_edge: 3.6e-3, rings: 14, mean_radius: 0.022'
ALONE = 'plunger_mass_without_spring: 0.2534'


def close(value, expected, rel=1e-12):
    return value == pytest.approx(expected, rel=rel, abs=0.0)


def test_spring_geometry_gives_stiffness_and_mass_by_21_and_4():
    spring = SlottedSpring(**GEOMETRY)
    # 1.035*2.15e11*(3.6e-3)^4/(14*0.022^3); steel of 31.854 cm³.
    assert close(spring.stiffness, 250_722.168, rel=1e-8)
    assert close(spring.mass, 7850.0 * 31.8545e-6, rel=1e-5)
    design = Vibrator.from_spring_geometry(spring, 0.2534, preload=5e-3)
    assert design == Vibrator(slotted_spring_stiffness=spring.stiffness,
                              plunger_mass=0.2534 + spring.mass, preload=5e-3)


def test_spring_geometry_is_read_from_yaml_as_on_the_page():
    design = Vibrator.load_yaml(f'slotted_spring: {{{SPRING}, {ALONE}}}\npreload: 5e-3')
    expected = Vibrator.from_spring_geometry(SlottedSpring(**GEOMETRY), 0.2534, preload=5e-3)
    assert design == expected
    assert Vibrator.load_yaml(design.to_yaml()) == design
    page = PAGE.read_text(encoding='utf-8')
    example = re.search(r'```yaml\n(.*?)```', page, re.DOTALL).group(1)
    assert Vibrator.load_yaml(example) == expected.replace(preload=Vibrator().preload)


def test_density_and_youngs_modulus_of_the_spring_can_be_given():
    titanium = Vibrator.load_yaml(
        f'slotted_spring: {{{SPRING}, {ALONE}, youngs_modulus: 1.075e11, density: 3925}}')
    steel = SlottedSpring(**GEOMETRY)
    assert close(titanium.slotted_spring_stiffness, steel.stiffness / 2.0)
    assert close(titanium.plunger_mass, 0.2534 + steel.mass / 2.0)


def test_a_spring_by_geometry_makes_a_machine_that_runs():
    design = Vibrator.from_spring_geometry(SlottedSpring(**GEOMETRY), 0.2534)
    opened = Simulation(design).advance(0.3, sample_rate=1000).switches
    opened = opened[opened['before'] == kernel.PHASE_CLOSED]
    assert 1.0 / np.diff(opened['time'])[-1] == pytest.approx(54.9, abs=0.2)


@pytest.mark.parametrize('text, words', [
    (f'slotted_spring: {{{SPRING}, {ALONE}}}\nplunger_mass: 0.5',
     ['plunger_mass = 0.5', 'slotted_spring', '0.503458']),
    (f'slotted_spring: {{{SPRING}, {ALONE}}}\nslotted_spring_stiffness: 2e5',
     ['slotted_spring_stiffness = 2e5', '250722']),
    (f'slotted_spring: {{{SPRING}}}', ['plunger_mass_without_spring', 'm8', 'missing', 'kg']),
    (f'slotted_spring: {{{ALONE}, rings: 3, mean_radius: 1}}', ['jumper_edge (a)', 'missing']),
    (f'slotted_spring: {{{SPRING}, plunger_mass_without_spring: -1}}',
     ['plunger_mass_without_spring (m8)', '-1 kg', 'above 0 kg']),
    ('slotted_spring: {jumpers: 14}', ['unknown', '"jumpers"', 'rings (n)', 'mean_radius (R)']),
    ('slotted_spring: 2.5e+5', ["'250000.0'", 'rings (n)']),
    ('slotted_spring:', ['None', 'jumper_edge']),
    (f'slotted_spring: {{jumper_edge: 0.03, rings: 14, mean_radius: 0.022, {ALONE}}}',
     ['mean_radius (R)', '0.022 m', 'jumper_edge (a)', '0.03 m']),
    (f'slotted_spring: {{jumper_edge: 1e-6, rings: 14, mean_radius: 0.022, {ALONE}}}',
     ['jumper_edge (a)', '1e-06 m', '[0.0001, 0.1] m']),
    (f'slotted_spring: {{jumper_edge: 3e-3, rings: 14.5, mean_radius: 0.022, {ALONE}}}',
     ['rings (n)', '14.5', 'whole number']),
    (f'slotted_spring: {{{SPRING}, {ALONE}, density: heavy}}', ['density (rho)', 'heavy']),
])
def test_a_bad_spring_is_refused_in_one_line_that_names_it(tmp_path, text, words):
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(VibratorError) as caught:
        Vibrator.load(path)
    message = str(caught.value)
    assert message.startswith(f'{path}: ') and '\n' not in message
    for word in ['slotted_spring', *words]:
        assert word in message, message


def test_geometry_and_its_result_at_once_are_refused_in_python_too():
    spring = SlottedSpring(**GEOMETRY)
    with pytest.raises(VibratorError, match='both plunger_mass = 0.5 and slotted_spring'):
        Vibrator.from_spring_geometry(spring, 0.25, plunger_mass=0.5)
    with pytest.raises(VibratorError, match='m8'):
        Vibrator.from_spring_geometry(spring, None)
