"""The scene as a person sees it, drawn without a screen; needs a Vulkan driver (Mesa's will do)."""
import os
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rerun')
pytest.importorskip('rclpy')

import viewer_recordings as made
from PIL import Image
from rerun.experimental import ViewerClient

from hpv_twin.viewer import palette, replay, viewer_process

SOFTWARE = sorted(Path('/usr/share/vulkan/icd.d').glob('lvp_icd*.json'))
# Where the views stand in a picture of 1920 x 1080: rows, columns.
CUTAWAY = np.s_[75:480, 5:755]
PORTRAIT = np.s_[525:825, 5:380]
SPECTRUM = np.s_[525:825, 390:755]
PRESSURE = np.s_[70:275, 785:1520]
POSITION = np.s_[325:525, 785:1520]
PHASES = np.s_[520:660, 765:1520]
WHOLE_RUN = np.s_[660:1050, 785:1520]
PERIOD = 1.0 / 55.0  # s

pytestmark = pytest.mark.skipif(not SOFTWARE, reason='no Vulkan driver to draw without a screen')


@pytest.fixture(scope='module')
def pictures(tmp_path_factory):
    """RGB (1080 x 1920 x 3) of ten seconds with a gap: the cursor at 6 s + four phases."""
    folder = tmp_path_factory.mktemp('picture')
    recording = made.write_twin(folder / 'run.mcap', seconds=14.0, gap=(2.0, 4.0), load=250.0)
    scene = folder / 'run.rrd'
    assert replay.main([str(recording), '--save', str(scene)]) == 0
    # On the seat under pressure, on its way, at full stroke, on its way back.
    times = {share: 5.5 + PERIOD * (0.5 + share) for share in (0.6, 0.74, 0.81, 0.93)}
    draw(scene, {folder / f'{share}.png': at for share, at in times.items()})
    return {share: np.asarray(Image.open(folder / f'{share}.png').convert('RGB')).astype(int)
            for share in times}


@pytest.fixture
def picture(pictures):
    return pictures[0.6]


def draw(scene, wanted):
    """Let a viewer draw `scene` into the files `wanted`, each with its cursor at a time (s)."""
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    folder = next(iter(wanted)).parent
    viewer = subprocess.Popen(
        [viewer_process.executable(), '--headless', '--bind', '127.0.0.1', '--port', str(port),
         '--window-size', '1920x1080', str(scene)],
        env=dict(os.environ, RUST_LOG='error', VK_ICD_FILENAMES=str(SOFTWARE[0]),
                 XDG_RUNTIME_DIR=str(folder)))
    try:
        client = patiently(lambda: ViewerClient.connect(f'rerun+http://127.0.0.1:{port}/proxy'))
        for png, at in wanted.items():
            patiently(lambda at=at: client.set_time('time', duration=at, play_state='paused'))
            time.sleep(2.0)  # the axes settle
            client.save_screenshot(str(png))
    finally:
        viewer.terminate()
        viewer.wait(10)


def patiently(action, seconds=30.0):
    """The result of `action`, tried until the viewer is there."""
    end = time.monotonic() + seconds
    while True:
        try:
            return action()
        except Exception:
            if time.monotonic() > end:
                raise
            time.sleep(0.3)


def drawn(picture, quantity, place):
    """Where (rows, columns) in a part there is this quantity's colour, in any brightness."""
    part = picture[place]
    brightness = part.max(axis=2)
    colour = np.array(list(quantity.rgba().to_bytes(4, 'big')[:3]))
    distance = np.abs(part / np.maximum(brightness, 1)[..., None] - colour / colour.max())
    return np.nonzero((distance.max(axis=2) < 0.1) & (brightness > 90))


def test_single_cycles_swing_over_the_whole_plot(picture):
    for quantity, place in ((palette.PRESSURE, PRESSURE), (palette.VALVE_SLEEVE, POSITION)):
        rows, columns = drawn(picture, quantity, place)
        assert np.ptp(rows) > 130  # of about 200: a mean would be flat
        assert np.ptp(columns) > 690
        assert np.unique(columns).size > 300


def test_opening_and_return_are_marked(picture):
    for mark in (palette.OPENING, palette.RETURN):
        part = picture[PRESSURE]
        colour = np.array(list(mark.rgba().to_bytes(4, 'big')[:3]))
        assert np.count_nonzero(np.abs(part - colour).max(axis=2) < 12) > 150


def test_the_whole_run_is_a_band_with_a_gap(picture):
    rows, columns = drawn(picture, palette.PRESSURE, WHOLE_RUN)
    assert np.ptp(rows) > 45
    assert np.ptp(columns) > 690
    widest = np.diff(np.unique(columns)).max()
    assert 80 < widest < 130  # a seventh of the run is not there


@pytest.mark.parametrize('name', ['frequency', 'stroke', 'pump_flow', 'preload', 'load'])
def test_every_strip_has_its_line(picture, name):
    _, columns = drawn(picture, palette.NUMBERS[name], WHOLE_RUN)
    assert np.unique(columns).size > 200
    assert np.ptp(columns) > 280


def test_portrait_and_spectrum_are_drawn(picture):
    rows, columns = drawn(picture, palette.PLUNGER, PORTRAIT)
    assert np.ptp(rows) > 80
    assert np.ptp(columns) > 180
    rows, columns = drawn(picture, palette.PLUNGER, SPECTRUM)
    assert np.ptp(rows) > 150
    assert np.ptp(columns) > 150


def test_phases_are_a_band_of_four_colours(picture):
    colours, counts = np.unique(picture[PHASES].reshape(-1, 3), axis=0, return_counts=True)
    common = colours[counts > 150]
    band = [colour for colour in common.tolist() if max(colour) - min(colour) > 25]
    assert len(band) >= 4  # the greys around it are not counted


def test_the_cutaway_moves(pictures):
    tips = [drawn(pictures[share], palette.PLUNGER, CUTAWAY)[1].max() for share in pictures]
    closed, forward, opened, back = tips
    assert closed + 8 < forward < opened - 8
    assert closed + 8 < back < opened - 8
    assert 35 < opened - closed < 70  # 12 mm of 180 in 750 columns
    sleeves = [drawn(pictures[share], palette.VALVE_SLEEVE, CUTAWAY)[1].min()
               for share in (0.6, 0.81)]
    assert 35 < sleeves[1] - sleeves[0] < 70


def test_the_oil_shines_under_pressure(pictures):
    pressed, drained = (drawn(pictures[share], palette.PRESSURE, CUTAWAY)[0].size
                        for share in (0.6, 0.81))
    assert pressed > 1500
    assert drained < pressed / 5


def test_nothing_is_blank(picture):
    for place in (CUTAWAY, PORTRAIT, SPECTRUM, PRESSURE, POSITION, PHASES, WHOLE_RUN,
                  np.s_[845:1045, 10:700], np.s_[70:480, 1540:1900], np.s_[560:1040, 1540:1900]):
        assert np.count_nonzero(picture[place].max(axis=2) > 120) > 400
