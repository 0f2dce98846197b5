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
CYCLES = slice(0, 790)  # columns of a picture 1920 wide: single cycles, then the whole run
WHOLE_RUN = slice(810, 1430)

pytestmark = pytest.mark.skipif(not SOFTWARE, reason='no Vulkan driver to draw without a screen')


@pytest.fixture(scope='module')
def picture(tmp_path_factory):
    """RGB (1080 x 1920 x 3) of ten seconds with a gap, the cursor at 7 s."""
    folder = tmp_path_factory.mktemp('picture')
    recording = made.write_twin(folder / 'run.mcap', seconds=10.0, gap=(2.0, 4.0))
    scene, png = folder / 'run.rrd', folder / 'run.png'
    assert replay.main([str(recording), '--save', str(scene)]) == 0
    draw(scene, png, at=7.0)
    return np.asarray(Image.open(png).convert('RGB')).astype(int)


def draw(scene, png, at):
    """Let a viewer draw `scene` with its cursor `at` a time (s)."""
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    viewer = subprocess.Popen(
        [viewer_process.executable(), '--headless', '--bind', '127.0.0.1', '--port', str(port),
         '--window-size', '1920x1080', str(scene)],
        env=dict(os.environ, RUST_LOG='error', VK_ICD_FILENAMES=str(SOFTWARE[0]),
                 XDG_RUNTIME_DIR=str(png.parent)))
    try:
        client = patiently(lambda: ViewerClient.connect(f'rerun+http://127.0.0.1:{port}/proxy'))
        patiently(lambda: client.set_time('time', duration=at, play_state='paused'))
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


def drawn(picture, quantity, columns):
    """Where (rows, columns) there is this quantity's colour, in any brightness."""
    part = picture[:, columns]
    brightness = part.max(axis=2)
    colour = np.array(list(quantity.rgba().to_bytes(4, 'big')[:3]))
    distance = np.abs(part / np.maximum(brightness, 1)[..., None] - colour / colour.max())
    return np.nonzero((distance.max(axis=2) < 0.1) & (brightness > 90))


def test_single_cycles_swing_over_the_whole_plot(picture):
    for quantity in (palette.PRESSURE, palette.VALVE_SLEEVE):
        rows, columns = drawn(picture, quantity, CYCLES)
        assert np.ptp(rows) > 300  # of about 450: a mean would be flat
        assert np.ptp(columns) > 700
        assert np.unique(columns).size > 300


def test_the_whole_run_is_a_band_with_a_gap(picture):
    rows, columns = drawn(picture, palette.PRESSURE, WHOLE_RUN)
    assert np.ptp(rows) > 100
    assert np.ptp(columns) > 560
    widest = np.diff(np.unique(columns)).max()
    assert 80 < widest < 160  # a fifth of the run is not there


@pytest.mark.parametrize('name', ['frequency', 'stroke', 'pump_flow', 'preload', 'load'])
def test_every_strip_has_its_line(picture, name):
    _, columns = drawn(picture, palette.NUMBERS[name], WHOLE_RUN)
    assert np.unique(columns).size > 300
    assert np.ptp(columns) > 560
