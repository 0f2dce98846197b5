"""The search for the base design ends near the built-in one, which also meets the targets."""
import pytest

from hpv_twin.model import Vibrator
from hpv_twin.study import base_design


def test_search_from_round_numbers_ends_near_the_built_in_design(capsys, tmp_path):
    path = tmp_path / 'found.yaml'
    assert base_design.main(['-o', str(path)]) == 0
    found, built_in = Vibrator.load(path), Vibrator()
    for name in base_design.FREE:
        assert getattr(found, name) == pytest.approx(getattr(built_in, name), rel=5e-3)
    reached = base_design.results(found)
    for name, target in base_design.TARGETS.items():
        assert reached[name] == pytest.approx(target, rel=1e-6)
