"""`replay --web` shows the scene in a browser; Debian's Chromium, without a screen, is one."""
import base64
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip('rerun')
pytest.importorskip('rclpy')

import viewer_recordings as made
from PIL import Image

from hpv_twin.viewer import palette

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
PATIENCE = 120.0  # s; WebGL is computed here, without a graphics card
FLAGS = ('--headless=new', '--no-sandbox', '--no-first-run', '--disable-quic', '--disable-sync',
         '--disable-background-networking', '--disable-component-update', '--hide-scrollbars',
         '--enable-unsafe-swiftshader', '--use-angle=swiftshader', '--window-size=1920,1080',
         '--remote-debugging-pipe')

pytestmark = pytest.mark.skipif(not CHROMIUM, reason='no Chromium (Debian: apt install chromium)')


class Browser:
    """Chromium, spoken to over a pair of pipes."""

    def __init__(self, folder):
        (theirs_in, self._out), (self._in, theirs_out) = os.pipe(), os.pipe()

        def rewire():
            os.dup2(theirs_in, 3)
            os.dup2(theirs_out, 4)
        # Out of the way of 3 and 4 first.
        theirs_in, theirs_out = (move(end) for end in (theirs_in, theirs_out))
        self.process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f'--user-data-dir={folder}', 'about:blank'], preexec_fn=rewire,
            close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True)
        os.close(theirs_in)
        os.close(theirs_out)
        self._rest, self._number, self._session = b'', 0, None
        page = next(target for target in self.ask('Target.getTargets')['targetInfos']
                    if target['type'] == 'page')
        self._session = self.ask('Target.attachToTarget', targetId=page['targetId'],
                                 flatten=True)['sessionId']

    def ask(self, method, **parameters):
        """Return the answer to a command of the DevTools protocol."""
        self._number += 1
        message = {'id': self._number, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._out, json.dumps(message).encode() + b'\0')
        while True:
            while b'\0' not in self._rest:
                part = os.read(self._in, 1 << 16)
                assert part, 'Chromium has ended'
                self._rest += part
            text, self._rest = self._rest.split(b'\0', 1)
            answer = json.loads(text)
            if answer.get('id') == self._number:
                return answer.get('result', {})

    def picture(self, path):
        """Return what the page looks like, RGB (rows x columns x 3)."""
        data = self.ask('Page.captureScreenshot').get('data')
        if data is None:  # between two pages
            return np.zeros((1080, 1920, 3), int)
        path.write_bytes(base64.b64decode(data))
        return np.asarray(Image.open(path).convert('RGB')).astype(int)

    def close(self):
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self._out)
        os.close(self._in)


def move(end):
    """Return a copy of a pipe's end with a high number."""
    import fcntl
    high = fcntl.fcntl(end, fcntl.F_DUPFD, 100)
    os.close(end)
    return high


def test_a_browser_shows_the_scene(tmp_path):
    recording = made.write_twin(tmp_path / 'run.mcap', seconds=2.0)
    command = 'import sys; from hpv_twin.viewer.replay import main; sys.exit(main(sys.argv[1:]))'
    process = subprocess.Popen([sys.executable, '-c', command, '--web', str(recording)],
                               stdout=subprocess.PIPE, text=True)
    browser = None
    try:
        said = [process.stdout.readline() for _ in range(2)]
        (address,) = re.findall(r'http://127\.0\.0\.1:\S+', said[-1])
        browser = Browser(tmp_path / 'profile')
        browser.ask('Emulation.setDeviceMetricsOverride', width=1920, height=1080,
                    deviceScaleFactor=1, mobile=False)
        browser.ask('Emulation.setEmulatedMedia', features=[
            {'name': 'prefers-color-scheme', 'value': 'dark'}])
        browser.ask('Page.navigate', url=address)
        wait_for_curves(browser, tmp_path / 'web.png')
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        if browser:
            browser.close()


def wait_for_curves(browser, png):
    """Wait until pressure, positions and the cutaway are drawn."""
    end = time.monotonic() + PATIENCE
    while True:
        picture = browser.picture(png)
        found = [np.count_nonzero(np.abs(picture - colour(quantity)).max(axis=2) < 40)
                 for quantity in (palette.PRESSURE, palette.PLUNGER, palette.VALVE_SLEEVE)]
        if found[0] > 800 and found[1] > 5000 and found[2] > 2000:
            return
        assert time.monotonic() < end, found
        time.sleep(1.0)


def colour(quantity):
    return np.array(list(quantity.rgba().to_bytes(4, 'big')[:3]))
